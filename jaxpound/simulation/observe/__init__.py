"""What is kept of the instants of a run.

``tally``, with ``link_tally`` and ``peaks``, accumulates the scalars of a ``Demand``; ``series``
makes the series of a ``Response``.
"""
