"""Layouts of files of accelerograms, one module for each, and modules that they share.

A layout is a ``Format``; a new one is a module with a ``FORMAT`` and its place in ``FORMATS``.
``text`` has lines, ``rows`` the numbers on them, ``header`` what is stated in prose, ``units`` how
units are written.
"""

from jaxpound.ground.formats import at2, columns, knet

FORMATS = (knet.FORMAT, at2.FORMAT, columns.FORMAT)
"""The first that fits a file reads it; the last fits every file."""
