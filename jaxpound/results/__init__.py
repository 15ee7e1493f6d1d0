"""Results: the series and scalars of a run, and tables of them.

``response`` has the series, ``demand`` the scalars, both by mass, rod and link and as tables
(``elements``); ``named`` knows every demand by its name.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
