"""Seismic hazard: annual rates of pounding, and analyses of recorded earthquakes.

``curve`` is a site's hazard curve, ``points`` its points and their files; ``annual_rate`` is the
rate of pounding that follows from it. An ``analysis`` is buildings under records, with its runs:
``ida`` scales these until a demand reaches its threshold; ``stripes`` and ``cloud`` are the two
other ways from records to a fragility, which ``capacities`` fits.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
