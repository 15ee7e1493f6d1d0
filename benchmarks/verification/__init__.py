"""The verification suite: python -m benchmarks.verification; a module for each case.

Each module's ``case`` computes a problem of known solution and returns a ``Case``: errors by step
with their fitted order, numbers side by side, times. Tests run the same functions with few steps.
"""
