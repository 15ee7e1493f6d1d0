"""What stands: masses, rods and links, their physics without numerics.

``rod`` has the fractional Zener law, ``contact`` the laws of contact, ``system`` rods and links
between masses, ``structures`` the paper's two structures and the damper between them, ``building``
a building in SI units; ``storeys``, ``row`` and ``shear_building`` buildings of several storeys,
and ``vibration`` their modes; ``places`` says in words where masses, rods and links are, and
``parameters`` reads and changes the parameters of any of them by path.
"""
