"""Layouts of files of accelerograms: a table of formats, and the modules that read by it.

A format is a ``Layout`` (``layout``): its signature, and where count, interval, unit, components
and values stand; ``table`` lists them. ``blocks`` reads formats whose components have headers of
their own, ``columns`` rows behind one header, ``knet`` counts with a scale, ``json_events`` JSON.
``text`` reads lines, ``spreadsheet`` brings them into plain form, ``rows`` reads their numbers;
``statements`` finds counts and intervals in prose, ``header`` and ``units`` units.
"""
