from .demand import Demand as Demand
from .energy import Energy as Energy
from .floors import FloorDemands as FloorDemands
from .floors import floor_demands as floor_demands
from .impacts import Phase as Phase
from .response import Response as Response
