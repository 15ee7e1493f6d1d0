"""The best damper: design spaces, ensembles of earthquakes, objectives and the search.

``run`` has ``design_damper`` and ``design`` its result; ``space``, ``ensemble`` and ``objective``
say what is sought; ``search`` and ``optimum`` find it; ``pareto``, ``elasticity`` and
``calibration`` answer related questions.
"""
