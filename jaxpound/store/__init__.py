"""Finished runs in files, so that a stopped computation can continue.

``archive`` writes files whole or not at all and detects damage; ``store`` is a folder of finished
chunks with a manifest, of a study or of the runs of an analysis in any order.
"""
