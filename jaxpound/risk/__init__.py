"""Rare events: how improbable it is that a demand is reached, and by which earthquakes it is.

``limit_state`` defines the event, ``rare_event`` is the result of every method.
"""
