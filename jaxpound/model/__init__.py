"""What stands: rods, buildings and the pair of structures, as physics has them.

``rod`` has the fractional Zener law, ``structures`` two structures and the damper between them, and
``building`` a building in SI units.
"""
