"""Contact, and joints that share masses, within one step of a run.

``coupled`` is what a step uses: groups of joints that may touch or that share masses, those of the
same shape together. ``group`` moves one of them over the step: in closed form, or where it needs
that by a local flow from event to event (``flows``). ``local_flow`` is its loop, ``events`` the
table of what may happen, ``zeros`` finds when, and ``forces`` has the forces. ``substeps`` are the
smooth motion between events: power series, or the Runge–Kutta method of ``dop853``. ``records``
holds inputs and results. A joint has any number of gaps, each on one side of it.
"""
