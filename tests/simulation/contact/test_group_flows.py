"""Groups of links whose flows are one program."""

import numpy as np
import pytest

import jaxpound as jp

GRID = jp.TimeGrid(0.02, 400)
RODS = [jp.Rod(jp.ZenerRod(0.5, 0.05, 0.2), k) for k in (4.0, 9.0, 15.0, 6.0, 8.0, 20.0)]
LAW = jp.Newton(0.6)
ONE_SIDE, BOTH = ({"friction": 0.05, "gap": gap, "contact": LAW} for gap in (0.1, (0.1, 0.08)))


def pounding(*links):
    """Masses, each on a rod of its own, with links between them and to the ground."""
    n = 1 + max(max(link.ends) for link in links)
    rods = [jp.Rod(rod.material, rod.stiffness, (i, jp.GROUND)) for i, rod in enumerate(RODS[:n])]
    return jp.System((1.0,) * n, rods, links)


ROW = [((0, 1), BOTH), ((1, 2), ONE_SIDE)], [((3, 4), ONE_SIDE), ((4, 5), BOTH)]
BASE = [((0, jp.GROUND), ONE_SIDE)], [((1, 2), ONE_SIDE)]


@pytest.mark.parametrize("groups", [ROW, BASE], ids=["faces", "on the ground"])
def test_groups_of_the_same_shape_differ_in_their_faces_and_on_the_ground(groups):
    """A group moves as it does alone, under a ground motion that starts at its peak."""
    first, others = ([jp.Link(ends, **numbers) for ends, numbers in group] for group in groups)
    ground = jp.Ricker(1.5, (2.0, 3.0), (0.0, 3.0))
    expected = jp.demand(pounding(*first), ground, GRID).masses
    for links in ((*first, *others), (*others, *first)):
        masses = jp.demand(pounding(*links), ground, GRID).masses[: len(expected)]
        peaks = [[float(mass.peak_x) for mass in seen] for seen in (masses, expected)]
        np.testing.assert_allclose(*peaks, rtol=1e-9)
