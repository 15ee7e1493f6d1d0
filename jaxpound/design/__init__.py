"""The best damper: design spaces, ensembles of earthquakes, objectives and the search.

``run`` has ``design_damper`` and ``design`` its result. ``space``, ``ensemble`` and ``objective``
say what is sought, ``problem`` puts them together; ``search`` is the loop of iterations, each one
of ``lagrangian``; ``optimum`` has the last steps. ``pareto``, ``elasticity`` and ``calibration``
answer related questions.
"""
