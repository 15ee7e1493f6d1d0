# Public names for type checkers; __init__.py imports a module when a name is first used.

from . import design as design
from . import ground as ground
from . import hazard as hazard
from . import model as model
from . import paper as paper
from . import plots as plots
from . import reliability as reliability
from . import results as results
from . import scenarios as scenarios
from . import simulation as simulation
from . import study as study
from ._errors import InvalidInput as InvalidInput
from ._errors import PlausibilityWarning as PlausibilityWarning
from ._version import __version__ as __version__
from ._xla.batches import in_chunks as in_chunks
from ._xla.batches import use_cores as use_cores
from ._xla.programs import keep_programs as keep_programs
from ._xla.programs import use_loop_kernels as use_loop_kernels
from .buildings import Buildings as Buildings
from .design import *
from .grid import TimeGrid as TimeGrid
from .ground import *
from .hazard import *
from .model import *
from .model import contact as contact
from .quantities import STANDARD_GRAVITY as STANDARD_GRAVITY
from .reliability import *
from .results import *
from .scenarios import *
from .simulation import *
from .study import *
from .units import Scales as Scales
