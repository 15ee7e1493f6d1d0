"""The best damper: design spaces, ensembles of earthquakes, objectives and the search.

``run`` has ``design_damper`` and ``design`` its result. ``space``, ``ensemble`` and ``objective``
define a design problem, ``problem`` puts them together; ``search`` is the loop of iterations,
``lagrangian`` one iteration; ``optimum`` polishes the best design. ``pareto``, ``elasticity`` and
``calibration`` answer related questions.
"""
