"""Links of two faces, against a reference that goes from event to event, and against themselves."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.contact.records import SLOTS
from tests.simulation import moats
from tests.simulation.contact.test_flows import follow, start_of

ONE = moats.CASES["one mass"]
WITHIN = {  # shares of the largest displacement, and of the derivatives
    "one mass": (1e-3, 1e-3),
    "narrow slot": (0.02, 0.02),
    "storey above": (2e-3, 0.01),
}


@pytest.mark.parametrize("name", WITHIN)
def test_runs_and_their_derivatives_are_those_of_the_reference(name):
    moats.check(name, *WITHIN[name])


def test_both_faces_are_hit_again_and_again_within_one_step():
    """By Newton's law, against the sum of the flights between the walls."""
    restitution, left, right, step = 0.7, 0.0015, 0.002, 0.04
    start = start_of(jp.Newton(restitution), 1.0, [right, left], 0.5, gaps=((0, 1), (0, -1)))
    end = jax.jit(lambda x: follow(step, SLOTS, x))(start)
    place, speed, time, touches = right, 1.0, right, [0, 0]
    while time < step:
        touches[int(place < 0)] += 1
        speed, other = restitution * speed, -left if place > 0 else right
        begin, place, time = (place, time), other, time + (left + right) / speed
    position = begin[0] + np.sign(place - begin[0]) * speed * (step - begin[1])
    assert end.gaps.log.touches.tolist() == touches == [3, 2]
    assert float(end.closing[0]) == pytest.approx(position, rel=1e-10)
    np.testing.assert_allclose(np.abs(end.velocity), speed, rtol=1e-12)
    assert float(end.gaps.lost_after.sum()) == pytest.approx(1 - speed**2, rel=1e-12)
    assert (end.turns.farthest[0], end.turns.nearest[0]) == pytest.approx((right, -left), rel=1e-12)


@pytest.mark.parametrize("next_floor", [jp.GROUND, None])
def test_gaps_on_both_sides_without_contact_leave_the_motion_as_it_is(next_floor):
    """Of a base that slides on the ground, far from its wall, and between two buildings."""
    rods = (jp.Rod(jp.ZenerRod(0.5, 0.01, 0.05), stiffness) for stiffness in (20.0, 9.0))
    storeys = tuple(jp.Storeys((1.0,), rod) for rod in rods)

    def run(gap):
        link = jp.FloorLink(0, 0, next_floor, friction=0.05, gap=gap)
        return jp.demand(jp.Row(storeys, (link,)), jp.paper.ground(), moats.GRID)

    one_side, both = run(2.0), run((1.5, 2.0))
    (alone,), (face, other) = one_side.links, both.links
    np.testing.assert_allclose(*map(jax.tree.leaves, (both.masses, one_side.masses)), rtol=1e-12)
    for name in ("min_gap", "residual_offset", "slip_distance"):
        np.testing.assert_allclose(getattr(face, name), getattr(alone, name), rtol=1e-12)
    assert other.residual_offset == -face.residual_offset != 0
    assert other.slip_distance == face.slip_distance


@pytest.mark.parametrize("name", ["one mass", "storey above"])
def test_the_mirror_image_has_the_faces_of_the_other_side(name):
    moats.check_mirror(name)


def lost(system, ground):
    demand = jp.demand(system, ground, moats.GRID, only=("contact_work_1", "contact_work_2"))
    return sum(link.contact_work for link in demand.links)


def test_reverse_mode_is_forward_mode_and_a_batch_is_a_loop():
    cases = [moats.changed(ONE, "link.gap.0", gap) for gap in (0.09, 0.12, 0.2, 3.0)]
    systems, ground = [*map(moats.system_of, cases)], moats.ground_of(ONE)
    batch = jax.tree.map(lambda *x: np.array(x), *systems)
    backwards = jax.jit(jax.vmap(jax.value_and_grad(lost), in_axes=(0, None)))
    values, gradients = backwards(batch, ground)
    way = moats.direction(ONE, "link.gap.0")
    of_gap = sum(jax.tree.leaves(jax.tree.map(lambda x, y: x * y, gradients, way)))
    for system, together, gradient in zip(systems, values, of_gap, strict=True):
        (alone, _), (slope, _), response = moats.along(system, way, 1.0, ground)
        assert float(together) == pytest.approx(float(alone), rel=1e-10)
        assert float(gradient) == pytest.approx(float(slope), rel=1e-8, abs=1e-12)
    assert response.demand.n_impacts_1 > 0
    assert response.demand.n_impacts_2 == 0


def test_single_precision_stays_single():
    double = sum(link.contact_work for link in moats.response_of(ONE).demand.links)
    single = jax.jit(lost)(*jax.tree.map(np.float32, (moats.system_of(ONE), moats.ground_of(ONE))))
    assert single.dtype == np.float32
    assert float(single) == pytest.approx(float(double), rel=1e-4)


def test_a_face_that_cannot_close_is_none():
    """One face, and two of which one is at infinity, of the same neighbours the other way round."""
    (rod,) = moats.system_of(ONE).rods
    law, grid = jp.KelvinVoigt(2500.0, 0.8), jp.TimeGrid(0.04, 200)
    ground = jp.Ricker(0.25, [1.6, 2.4], [3.4, 5.6])
    here, back = (0, jp.GROUND), (jp.GROUND, 0)
    links = jp.Link(here, 0.1, 0.15, law), jp.Link(back, 0.1, (0.15, np.inf), law)
    one, two = (jp.demand(jp.System((1.0,), (rod,), (x,)), ground, grid) for x in links)
    assert one.n_impacts == 3
    assert float(two.peak_x1) == pytest.approx(float(one.peak_x1), rel=1e-7)
    for name in ("min_gap", "peak_contact", "peak_impulse", "contact_work", "n_impacts"):
        ours = float(getattr(two.links[1], name))
        assert ours == pytest.approx(float(getattr(one.links[0], name)), rel=1e-6)
    assert float(two.links[0].friction_work) == pytest.approx(float(one.friction_work), rel=1e-7)
    assert two.links[0].peak_contact is None
    assert np.isinf(two.links[0].min_gap)


def test_a_row_has_the_faces_of_its_links_also_where_it_is_traced():
    steel = jp.ZenerRod(1.0, 0.03, 0.15)
    link = jp.FloorLink(0, 0, friction=0.1, gap=(0.1, 0.2), next_building=jp.GROUND)
    row = jp.Row((jp.Storeys((1.0,), jp.Rod(steel, 4.0)),), (link,))
    rod, same = jp.Rod(steel, 4.0, (0, jp.GROUND)), jp.Link((0, jp.GROUND), 0.1, (0.1, 0.2))
    system = jp.System((1.0,), (rod,), (same,))
    assert jax.tree.structure(row.system()) == jax.tree.structure(system)
    assert jax.tree.leaves(row.system()) == jax.tree.leaves(system)
    assert [x.gap for x in system.links] == [0.2, 0.1]
    assert [(x.ends, x.friction) for x in system.links] == [((0, -1), 0.1), ((-1, 0), 0.0)]
    again = jax.eval_shape(lambda x: dataclasses.replace(x, masses=(2.0,)), system)
    assert again.topology == system.topology
