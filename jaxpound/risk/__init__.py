"""Rare events: how improbable it is that a demand is reached, and by which earthquakes it is.

``limit_state`` defines the event, ``rare_event`` is the result of every method. ``hazard`` is a
site's hazard curve, ``hazard_files`` reads it and ``hazard_intensity`` draws from it;
``annual_rate`` is what follows for pounding, and ``hazard_gap`` for the gap.
"""
