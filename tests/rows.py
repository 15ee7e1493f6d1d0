"""Two buildings of two storeys, a damper between their floors each; random earthquakes for them."""

import dataclasses

import jaxpound as jp

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
GRID = jp.TimeGrid(0.1, 60)
GAPS = (0.06, 0.1)
SOFT, STIFF = (jp.Storeys((1.0, 0.8), jp.Rod(STEEL, k)) for k in (12.0, 30.0))
LINKS = tuple(jp.FloorLink(0, i, friction=0.03, gap=gap) for i, gap in enumerate(GAPS))
ROW = jp.Row((SOFT, STIFF), LINKS)
WAVES = jp.RandomRicker(2, jp.LogNormal(0.05, 0.6), jp.Uniform(1.2, 3.0), jp.Uniform(1.0, 3.0))


def touching(law):
    """The row with a law of contact at its upper floors only."""
    lower, upper = ROW.links
    return dataclasses.replace(ROW, links=(lower, dataclasses.replace(upper, contact=law)))
