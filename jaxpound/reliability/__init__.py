"""Reliability: probabilities that demands exceed thresholds, and the ground motions that do it.

``limit_state`` defines the event, ``result`` its probability. ``run`` chooses the method:
``importance`` sampling around ``design_points`` at several ``instants``, or ``subset`` simulation.
``target`` leads from a probability to a parameter of the structures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
