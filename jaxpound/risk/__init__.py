"""Risk: how improbable it is that a demand is reached, and by which shaking it is.

``limit_state`` defines the event and ``rare_event`` is the result of every method. ``run`` begins a
``search``: ``design_points`` at many ``instants``, a ``mixture`` around them, and ``sampling`` from
it, ``kept`` in files. ``subset`` simulation goes through ``levels``, with its ``subset_runs``.
``slope`` and ``reach`` lead from a probability to parameters of the structures.

``hazard`` is a site's hazard curve, ``hazard_files`` reads it and ``hazard_intensity`` draws from
it; ``annual_rate`` is what follows for pounding, and ``hazard_gap`` for the gap.

``ida`` scales the records of a suite until a demand is reached; ``stripes`` and ``cloud`` are the
other two ways from records to a fragility; ``capacities`` fits one to capacities. All of them have
``suite_runs``. A ``ledger`` keeps runs in files, whatever their order.
"""
