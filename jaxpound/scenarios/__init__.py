"""Random scenarios: structures and ground motions as functions of standard normal numbers.

``distributions`` map a normal number to a parameter; ``random_structures``, ``random_ground``,
``random_noise`` and their sums have random parameters; ``scenarios`` combines them, and
``sampling`` draws the normal numbers of each sample.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
