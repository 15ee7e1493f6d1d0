"""Simulation: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation: ``history`` of the
rods, ``friction`` of the joints. ``rollout`` prepares a run: its ``constants``, its start, and the
loop over time of ``scan``. ``step`` is one step, and ``state`` has what it takes and gives. The
package ``rods`` has the laws of rods over a step. A joint that shares no mass and cannot touch
moves in closed form (``sliding``, ``coulomb``); the package ``contact`` moves all others, where
they need it from event to event. ``tally``, with ``link_tally`` and ``peaks``, accumulates the
scalars, and ``series`` makes the response. ``spectrum`` and ``divergence`` have special runs, and
``buildings`` runs in SI units; ``jaxpound._xla`` makes the programs of all of them fast.
``docs/numerics.md`` has the equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
