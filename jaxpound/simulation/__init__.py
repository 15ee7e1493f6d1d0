"""Simulation: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation: ``history`` of the
rods, ``friction`` of the joints. ``rollout`` prepares a run: its ``constants``, and the loop over
time of ``scan``. ``step`` is one step, and ``state`` what it takes and gives. The package ``rods``
has the laws of rods over a step. A joint that is alone slides (``sliding``) by ``coulomb`` in
closed form; the package ``contact`` follows joints that touch or share masses through the step,
from event to event. ``tally``, and ``link_tally`` for links, accumulates the scalars. ``buildings``
has runs in SI units; ``jaxpound._xla`` makes the programs of all of them fast.
``docs/numerics.md`` has the equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
