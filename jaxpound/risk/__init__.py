"""Rare events: how improbable it is that a demand is reached, and by which earthquakes it is.

``limit_state`` defines the event and ``rare_event`` is the result of every method. ``run`` begins a
``search``: ``design_points`` at many ``instants``, a ``mixture`` around them, and ``sampling`` from
it, ``kept`` in files. ``subset`` simulation goes through ``levels``. ``slope`` and ``reach`` lead
from a probability to parameters of the structures.
"""
