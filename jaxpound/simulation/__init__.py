"""Simulation: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation, and ``rollout``
prepares a run: its ``constants``, its start, and the loop over the instants of ``time``. ``step``
is one step, and ``state`` has what it takes and gives; ``rods``, ``joints`` and ``contact`` have
the parts of it. ``observe`` has what is kept of the instants, and ``time_steps`` chooses a grid;
``jaxpound._xla`` makes the programs of all of them fast. ``docs/numerics.md`` has the equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
