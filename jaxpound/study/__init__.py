"""Many earthquakes: scenarios, Monte Carlo, what it says, and how it is kept.

``scenarios`` and ``distributions`` say what is random, ``sampling`` draws, ``chunk`` runs a part
and ``run`` all of a study; ``store``, ``archives`` and ``identity`` keep it; ``study`` is the
result, ``statistics``, ``fragility`` and ``sensitivity`` what follows from it.
"""
