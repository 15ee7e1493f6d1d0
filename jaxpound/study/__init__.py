"""Monte Carlo studies: many earthquakes, statistics of their demands, fragilities, sensitivities.

``run`` runs a study ``chunk`` by chunk and keeps what its ``storage`` says; ``study`` is the
result, with the ``demands``, their ``statistics`` (with ``weighting`` for samples of unequal
weight), required ``gaps`` and ``fragility``. ``sensitivity`` computes Sobol indices, ``spectrum``
the ductilities of many oscillators, ``divergence`` the growth of a small change of a run, and
``rod_tests`` the force of a rod alone.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
