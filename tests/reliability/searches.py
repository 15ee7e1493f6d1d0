"""Searches of limit states, which may be stand-ins, with the defaults of what users call."""

from jaxpound.reliability import EventSearch, SubsetSearch, run, subset


def event_of(state, *, cov=0.1, key=0, store=None, progress=True, **options):
    """``rare_event`` of a limit state; the further options are those of an ``EventSearch``."""
    return run.event_of(state, cov, EventSearch(**options), key, store, progress)


def simulated(state, *, cov=None, key=0, store=None, progress=True, **options):
    """``subset_simulation`` of a limit state; further options are those of a ``SubsetSearch``."""
    return subset.simulated(state, cov, SubsetSearch(**options), key, store, progress)
