"""How XLA is brought to compute runs fast: a room that a reader of the physics need not enter.

``plan`` decides how the program of a run is laid out, from what a step computes, and ``blocks`` is
the loop over its steps. ``quotients`` are computed once, and not anew for each use. ``derivatives``
says what reverse mode keeps, and differentiates loops in both modes. A batch is spread over devices
by ``batches``, takes a ``shortcut``, and computes in ``lanes`` what few of its runs need; ``alike``
compiles what is alike once. ``programs`` keeps what has been compiled.

Nothing here knows what is computed: no file imports the model or names a part of it.
"""
