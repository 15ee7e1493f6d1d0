"""Contact and links that share masses, within one step of a run.

``group`` is what a step uses: links that may touch or that share masses, and how their step ends.
``flows`` follows them from event to event where they need it, as joints, each with any number of
gaps on either side: ``local_flow`` is its loop,
``events`` the table of what may happen, ``zeros`` finds when, and ``forces`` has the forces.
``substeps`` are the smooth motion between them: power series, or the Runge–Kutta method of
``dop853``. ``records`` holds inputs and results. ``derivatives`` makes a function with a loop
differentiable in both modes, and ``lanes`` computes it for those runs of a batch that need it.
"""
