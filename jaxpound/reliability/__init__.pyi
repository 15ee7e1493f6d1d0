from .limit_state import LimitState as LimitState
from .result import DesignEarthquake as DesignEarthquake
from .result import RareEvent as RareEvent
from .run import rare_event as rare_event
from .subset import subset_simulation as subset_simulation
from .target import TargetResult as TargetResult
from .target import reach_probability as reach_probability
