"""Many earthquakes: scenarios, Monte Carlo studies, their statistics and their files.

``scenarios``, ``random_structures``, ``random_ground``, ``random_noise``, ``random_pulse``,
``site_noise``, their sums in ``ground_draw``, and ``distributions`` define what is random,
``sampling`` draws, ``chunk`` runs a part and ``run`` all of a study; ``store`` and ``archives`` are
its files; ``study`` is the result, from which ``statistics``, ``gaps``, ``fragility`` and
``sensitivity`` follow.
"""
