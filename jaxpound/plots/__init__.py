"""Figures of runs, records, studies, designs and the system itself, a module for each.

``runs`` draws responses, ``floors`` what is over the height of buildings, ``gap_maps`` the gaps of
many links, ``rows`` a row of buildings, ``yielding`` what yields; their functions are those of
``jaxpound.plots``. ``records``, ``studies``, ``designs`` and ``convergence`` draw what their names
say; ``system`` the blocks and rods; ``animation`` animates a run, ``explorer`` redraws it while
sliders are moved.

A function with an argument ``ax`` draws into these axes, by default those of a new figure, and
returns them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
