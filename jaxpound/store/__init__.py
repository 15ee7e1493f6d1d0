"""Finished runs in files, so that a stopped computation can continue.

``archive`` writes files whole or not at all and detects damage, ``store`` is a folder of finished
chunks with a manifest, and ``run_log`` stores the runs of an analysis there in any order.
"""
