"""The loop over time (``scan``), and the ``history`` of rods that have a memory."""
