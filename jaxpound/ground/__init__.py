"""Ground motions, their files, and measures of their intensity.

``motion`` defines the interface of a ground motion, with sums and scalings, and ``run_input`` what
a run takes of it; ``ricker`` has wavelets, ``pulse`` near-fault pulses, ``record`` accelerograms,
which ``reader`` reads from files of the layouts in ``formats``; ``suite``, ``target`` and
``scaling`` fit records to a spectrum; ``noise``, ``envelope`` and ``evolving`` make artificial
motions of white noise; ``intensity`` and ``measure`` have intensity measures; ``plausibility``
warns of implausible motions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
