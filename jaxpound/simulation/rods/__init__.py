"""Rods over one step of the time grid: ``law`` has what a run asks of each, ``laws`` finds it.

A law is a fractional rod (``zener``), a rod that yields (``yielding``, of which ``slider`` has the
bilinear rod in closed form), a fractional rod that yields (``laws``), or a dashpot on its brace
(``dashpot``).
"""
