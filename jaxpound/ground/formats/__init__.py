"""Layouts of files of accelerograms, one module for each, and modules that they share.

``at2`` and ``knet`` have ``fits``, which tests a file's lines: ``columns`` reads all other files.
``read`` returns the values; it takes the user's time step for files that state none, and a list to
which it adds warnings. ``text`` reads lines, ``rows`` their numbers, ``header`` statements in
prose, ``units`` units.
"""
