"""Contact within one step: the local flow of joints, from event to event.

``flows`` has the flow as a function that runs can differentiate and batch. ``local_flow`` is its
loop, ``events`` the table of what may happen, ``zeros`` finds when, and ``forces`` has the forces.
``substeps`` are the smooth motion between events: power series, or the Runge–Kutta method of
``dop853``. ``records`` holds inputs and results. A joint has any number of gaps, each on one side
of it.
"""
