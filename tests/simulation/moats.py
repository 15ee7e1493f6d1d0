"""Links of two faces as the reference ``moat.json`` has them, run at several steps by one program.

A run at the step h is made in a unit of time in which h is the grid's step. It rests at first, and
is shaken so late that it ends as the reference does.
"""

import copy
import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import load
from tests.simulation.pairs import in_unit_of_time, padded

END, EVERY, CASES = (load("moat")[name] for name in ("end", "every", "cases"))
STEPS = (0.04, 0.02, 0.01)
GRID = jp.TimeGrid(STEPS[0], round(END / STEPS[-1]))


def system_of(case):
    def rod(x):
        if "F" in x:
            material = jp.PowerLaw(x["F"], x["a"], x["v"])
        else:
            material = jp.ZenerRod(1.0, x["tf"], x["tx"])
        return jp.Rod(material, x["K"], tuple(x["ends"]))

    def law(x):
        return jp.KelvinVoigt(x["k"], x["e"]) if "k" in x else jp.Newton(x["e"])

    link, gain = case["link"], case["link"].get("velocity_friction")
    sides = tuple(link["ends"]), link["mu"], tuple(link["gap"]), tuple(map(law, link["faces"]))
    increase = gain and jp.VelocityFriction(gain["F"], gain["v"])
    rods = tuple(map(rod, case["rods"]))
    return jp.System(tuple(case["m"]), rods, (jp.Link(*sides, velocity_friction=increase),))


def changed(case, path, value):
    """The case with another number at a path, such as ``link.gap.0``."""
    case = copy.deepcopy(case)
    *places, last = [int(x) if x.isdigit() else x for x in path.split(".")]
    functools.reduce(operator.getitem, places, case)[last] = value
    return case


def direction(case, path):
    """Of a case's system: that of the number at a path."""
    other = system_of(changed(case, path, 0.123))
    return jax.tree.map(lambda x, y: float(x != y), system_of(case), other)


def ground_of(case, unit=1.0, sign=1.0):
    """Two wavelets or fewer, after a run in a unit of time has rested."""
    ricker = case["ricker"]
    arrivals = np.array(ricker["ts"]) + rests(unit)
    return padded(jp.Ricker(sign * ricker["u0"], ricker["tp"], arrivals), 2)


def rests(unit):
    """For how long a run rests at first."""
    return GRID.duration * unit - END


@jax.jit
def along(system, direction, unit, ground):
    """What the reference has derivatives of, these along a direction, and the response."""

    def run(system):
        response = jp.simulate(*in_unit_of_time(unit, system, ground), GRID)
        lost = sum(link.contact_work for link in response.demand.links) / unit**2
        return jnp.stack([lost, response.masses[0].x[-1]]), response

    return jax.jvp(run, (system,), (direction,), has_aux=True)


def response_of(case, unit=1.0, sign=1.0):
    system = system_of(case)
    still = jax.tree.map(lambda x: 0.0, system)
    return along(system, still, unit, ground_of(case, unit, sign))[2]


@functools.cache
def runs(name):
    """By step: derivatives by the reference's numbers, and the response."""
    case, by_step = CASES[name], {}
    ways = [direction(case, path) for path in case["derivatives"]]
    for step in STEPS:
        inputs = step / GRID.dt, ground_of(case, step / GRID.dt)
        each = [along(system_of(case), way, *inputs) for way in ways]
        by_step[step] = np.stack([slope for _, slope, _ in each]), jax.device_get(each[0][2])
    return by_step


def errors_of_displacements(case, response, step):
    instants = (rests(step / GRID.dt) + EVERY * np.arange(1, len(case["x"]) + 1)) / step
    x = np.stack([mass.x for mass in response.masses], -1)[np.round(instants).astype(int)]
    return np.abs(x - np.array(case["x"]))


def check(name, displacements, slopes):
    """A case is of second order, and at last within these shares of x and of derivatives."""
    case, of_x, of_slopes = CASES[name], [], []
    size, exact = np.abs(case["x"]).max(), np.array([*case["derivatives"].values()])
    for step, (ours, response) in runs(name).items():
        of_x.append(errors_of_displacements(case, response, step) / size)
        of_slopes.append(np.linalg.norm((ours - exact) / np.linalg.norm(exact, axis=1)[:, None]))
    rms = [np.sqrt(np.mean(errors**2)) for errors in of_x]
    assert rms[0] > 11 * rms[-1], rms  # 16 would be of second order
    # The first may be small by chance.
    assert max(of_slopes) > 3.5 * of_slopes[-1], of_slopes
    assert of_x[-1].max() < displacements
    assert of_slopes[-1] < slopes
    check_scalars(case, response, STEPS[-1] / GRID.dt)


def check_scalars(case, response, unit):
    """Gaps, energies, forces and impacts of the last run, the left face first."""
    demand, energy = response.demand, response.energy
    links, force = demand.links[::-1], unit**2

    def compare(name, values, unit, **within):
        np.testing.assert_allclose(np.array(values, float) / unit, case[name], **within)

    compare("min_gap", [x.min_gap for x in links], 1.0, rtol=5e-3, atol=1e-10)
    compare("contact_lost", [x.contact_work for x in links], force, rtol=5e-3)
    compare("peak_force", [x.peak_contact for x in links], force, rtol=5e-3)
    if case["peak_impulse"]:
        compare("peak_impulse", [x.peak_impulse for x in links], unit, rtol=2e-3)
    compare("friction_work", energy.friction[-1], force, rtol=2e-3, atol=1e-12)
    lost = float(energy.contact_lost[-1]) / force
    assert lost == pytest.approx(sum(case["contact_lost"]), rel=5e-3)
    taken = [r.dissipated_energy for r in demand.rods if r.dissipated_energy is not None]
    compare("dissipated", sum(taken), force, rtol=2e-3)
    assert energy.relative_residual < 4e-3
    for face, side in enumerate(("left", "right")):
        # Newton's last rebounds before rest are not followed.
        exact = np.array([x for x in case["impacts"][face] if x[1] > 2e-3])
        impacts = [x for x in response.impacts() if x.between.endswith(side)]
        ours = [(x.time * unit - rests(unit), x.approach_velocity / unit) for x in impacts]
        ours = np.array([x for x in ours if x[1] > 2e-3])
        np.testing.assert_allclose(ours, exact, rtol=0, atol=2e-3)
        presses = np.asarray(response.links[1 - face].contact)
        assert presses.min() >= 0
        assert presses.max() <= demand.links[1 - face].peak_contact


def check_mirror(name):
    """A case and its mirror image: each face is that of the other side, but for rounding."""
    case = CASES[name]
    link = case["link"]
    swapped = case | {"link": {**link, "gap": link["gap"][::-1], "faces": link["faces"][::-1]}}
    ours, mirrored = response_of(case), response_of(swapped, sign=-1.0)
    assert ours.demand.n_impacts_1 >= 4
    within = {"rtol": 0, "atol": 1e-12}
    for mass, other in zip(ours.masses, mirrored.masses, strict=True):
        np.testing.assert_allclose(mass.x, -other.x, **within)
    for link, other in zip(ours.links, mirrored.links[::-1], strict=True):
        for name in ("gap", "contact", "contact_lost", "contact_stored", "touching"):
            np.testing.assert_allclose(getattr(link, name), getattr(other, name), **within)
    np.testing.assert_allclose(ours.links[0].friction, -mirrored.links[0].friction, **within)
    for name in ("min_gap", "peak_contact", "peak_impulse", "contact_work", "first_impact_time"):
        faces, others = ([getattr(x, name) for x in y.demand.links] for y in (ours, mirrored))
        np.testing.assert_allclose(faces, others[::-1], **within)
