"""Contact and links that share masses, within one step of a run.

``group`` is what a step uses: links that may touch or that share masses, and how their step ends.
``flow`` follows them from event to event where they need it: ``local_flow`` is its loop, ``events``
the table of what may happen, ``first_zero`` finds when, and ``forces`` are the forces in between.
``records`` holds inputs and results. ``derivatives`` makes a function with a loop differentiable in
both modes, ``lanes`` computes it for those runs of a batch that need it, and ``dop853`` is the
Runge–Kutta method.
"""
