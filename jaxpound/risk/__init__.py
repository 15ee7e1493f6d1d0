"""Risk: how probable it is that a demand is reached, by the shaking that is to be expected.

``ida`` scales the records of a suite until a demand is reached; ``stripes`` and ``cloud`` are the
other two ways from records to a fragility; ``capacities`` fits one to capacities.
"""
