"""Joints over one step: closings with friction, inerters and gaps.

``coupled`` has groups of joints that may touch or that share masses, those of the same shape
together, and ``group`` moves one of them, or a joint alone: in closed form by a law of
``friction``, or where it needs that by a local flow (``contact``). ``motion`` is what a law takes
and returns; ``coulomb`` solves Coulomb's.
"""
