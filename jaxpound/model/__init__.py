"""Structures: masses, rods and links, their physics without numerics.

``rod`` has the fractional Zener law, ``contact`` the laws of contact, ``system`` rods and links
between masses, ``structures`` the paper's two structures and floors on rods, ``building`` a
building in SI units; ``row`` and ``shear_building`` buildings of several storeys, ``vibration``
their modes, ``capacity_curve`` their pushover. ``places`` names masses, rods and links in words;
``parameters`` reads and changes parameters by path.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
