from .demand import Demand as Demand
from .floors import FloorDemands as FloorDemands
from .floors import floor_demands as floor_demands
from .impacts import FrictionPhase as FrictionPhase
from .response import Energy as Energy
from .response import Response as Response
