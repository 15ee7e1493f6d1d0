"""Many earthquakes: scenarios, Monte Carlo, what it says, and how it is kept.

``scenarios``, ``random_structures``, ``random_ground`` and ``distributions`` say what is random,
``sampling`` draws, ``chunk`` runs a part and ``run`` all of a study; ``store`` and ``archives``
keep it; ``study`` is the result, ``statistics``, ``fragility`` and ``sensitivity`` what follows
from it.
"""
