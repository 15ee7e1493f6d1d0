"""Figures of runs, records, studies, designs and the system itself, a module for each.

``runs`` draws responses, ``floors`` what is over the height of buildings, ``gap_maps`` the gaps of
many links, ``rows`` a row of buildings, ``yielding`` what yields; their functions are those of
``jaxpound.plots``. ``records``, ``studies``, ``designs`` and ``convergence`` draw what their names
say; ``system`` the blocks and rods; ``animation`` animates a run, ``explorer`` redraws it while
sliders are moved.

A function with an argument ``ax`` draws into these axes, by default those of a new figure, and
returns them.
"""

from jaxpound.plots.curves import same_units as same_units
from jaxpound.plots.floors import ductility as ductility
from jaxpound.plots.floors import envelope as envelope
from jaxpound.plots.floors import envelopes as envelopes
from jaxpound.plots.floors import mode_shapes as mode_shapes
from jaxpound.plots.gap_maps import gap_map as gap_map
from jaxpound.plots.rows import row as row
from jaxpound.plots.runs import contact_force as contact_force
from jaxpound.plots.runs import contact_hysteresis as contact_hysteresis
from jaxpound.plots.runs import displacements as displacements
from jaxpound.plots.runs import energy as energy
from jaxpound.plots.runs import friction_force as friction_force
from jaxpound.plots.runs import friction_hysteresis as friction_hysteresis
from jaxpound.plots.runs import gap as gap
from jaxpound.plots.runs import gaps as gaps
from jaxpound.plots.runs import ground_motion as ground_motion
from jaxpound.plots.runs import hysteresis as hysteresis
from jaxpound.plots.runs import overview as overview
from jaxpound.plots.runs import paper_figures as paper_figures
from jaxpound.plots.runs import rod_forces as rod_forces
from jaxpound.plots.runs import rod_hysteresis as rod_hysteresis
from jaxpound.plots.runs import side_by_side as side_by_side
from jaxpound.plots.runs import velocities as velocities
from jaxpound.plots.style import COLOURS as COLOURS
from jaxpound.plots.yielding import cyclic_test as cyclic_test
from jaxpound.plots.yielding import pushover as pushover
