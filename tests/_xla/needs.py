import numpy as np


def shares_in_need(size):
    """Runs of a batch in need: none, one, a group of 8 and more, all but one, and all."""
    counts = sorted({0, 1, min(8, size), min(9, size), size - 1, size})
    order = np.random.default_rng(size).permutation(size)
    return [(order < count) * 1.0 for count in counts]
