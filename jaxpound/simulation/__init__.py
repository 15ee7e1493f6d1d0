"""Simulation: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation: ``history`` of the
rods, ``friction`` of the links; the package ``rods`` has the laws of rods over a step. ``rollout``
prepares a run, ``stepping`` is one step, ``scan`` the loop over time, ``state`` what a step hands
to the next. A link that is alone slides by ``coulomb`` in closed form; the package ``contact``
follows links that touch or share masses through the step, from event to event. ``tally``, and
``link_tally`` for links, accumulates the scalars. ``batches`` has many runs at once, ``buildings``
runs in SI units.
``docs/numerics.md`` has the equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
