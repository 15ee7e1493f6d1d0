"""The best damper: design spaces, ensembles of earthquakes, objectives and the search.

``run`` has ``design_damper`` and ``design`` its result. ``space``, ``ensemble`` and ``objective``
define a design problem, ``problem`` puts them together; ``search`` is the loop of iterations,
``lagrangian`` one iteration; ``rare_limits`` repeats searches within limits on probabilities.
``pareto``, ``elasticity`` and ``calibration`` answer related questions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
