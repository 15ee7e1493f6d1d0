"""Joints over one step: closings with friction, inerters and gaps.

A joint that shares no mass with others and cannot touch moves in closed form (``sliding``) by a law
of ``friction``; ``coulomb`` solves Coulomb's. ``coupled`` has groups of joints that may touch or
that share masses, those of the same shape together, and ``group`` moves one of them: in closed
form, or where it needs that by a local flow (``contact``).
"""
