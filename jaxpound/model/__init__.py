"""What stands: masses, rods and links, as physics has them.

``rod`` has the fractional Zener law, ``system`` rods and links between masses, ``structures`` the
paper's two structures and the damper between them, ``building`` a building in SI units;
``parameters`` reads and changes what any of them is made of, by path.
"""
