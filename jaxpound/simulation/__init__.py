"""How it moves: the discretisation of the model, the time loop, and the runs.

``run`` has ``simulate`` and ``demand``; ``scheme``, ``history``, ``rod`` and ``friction`` are the
discretisation, ``tally`` the scalars as they pass, ``batches`` many runs at once, and ``buildings``
runs in SI units.
"""
