"""How it moves: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``. ``scheme`` chooses the discretisation: ``history`` and
``rod`` of the rods, ``friction`` of the links. ``stepping`` is one step, ``scan`` the loop over
time, ``tally`` accumulates the scalars. ``batches`` has many runs at once, ``buildings`` runs in SI
units.
"""
