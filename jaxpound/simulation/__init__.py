"""Simulation: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation: ``history`` and
``rod`` of the rods, ``friction`` of the links. ``rollout`` prepares a run, ``stepping`` is one
step, ``scan`` the loop over time, ``state`` what a step hands to the next. A link that is alone
slides by ``coulomb`` in closed form; the package ``contact`` follows links that touch or share
masses through the step, from event to event. ``tally``, and ``link_tally`` for links,
accumulates the scalars. ``buildings`` has runs in SI units; ``jaxpound._xla`` makes
the programs of all of them fast. ``docs/numerics.md`` has the equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
