"""Ground motions, their files, and measures of their intensity.

``motion`` defines the interface of a ground motion, with sums and scalings, and ``run_input`` what
a run takes of it; ``wavelets`` are closed forms, near-fault pulses too, and ``record`` is an
accelerogram, which ``reader`` reads from a file by its ``formats``; ``sequences`` puts motions one
after the other; ``suite`` reads folders, whose files ``stations`` pairs, and ``target`` fits them
to a spectrum; ``noise`` makes artificial motions of white noise; ``intensity`` and ``measure``
measure intensities; ``plausibility`` warns of implausible motions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
