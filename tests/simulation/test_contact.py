"""Runs with contact, against an independent solver that goes from event to event."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import load
from tests.simulation.test_events import LAWS

CASES = load("contact")["cases"]
PAIRS = [name for name in CASES if not name.startswith(("row3", "storeys"))]
GROUPS = [name for name in CASES if name not in PAIRS]


def law_of(link):
    return LAWS[link["law"]](link["k"], link["e"])


def system_of(case):
    """A case's system; the pair in the form that shares its program with other pairs."""
    system = case["system"]
    materials = [jp.ZenerRod(rod["order"], rod["tf"], rod["tx"]) for rod in system["rods"]]
    if "parameters" in case:
        p = case["parameters"]
        return jp.AdjacentStructures(
            *materials, p["rho"], p["eps"], p["mu"], p["gap0"], law_of(system["links"][0])
        )
    return jp.System(
        masses=tuple(system["m"]),
        rods=tuple(
            jp.Rod(material, rod["K"], (rod["b"], rod["a"]))
            for material, rod in zip(materials, system["rods"], strict=True)
        ),
        links=tuple(
            jp.Link((link["a"], link["b"]), link["mu"], link["gap0"], law_of(link))
            for link in system["links"]
        ),
    )


def ground_of(case):
    ricker = case["ricker"]
    return jp.Ricker(ricker["u0"], np.array(ricker["tp"], float), np.array(ricker["ts"], float))


def run(case, dt):
    return jp.simulate(system_of(case), ground_of(case), jp.TimeGrid.until(case["T"], dt=dt))


def errors(case, response, dt):
    """Of the displacements at the reference's instants, as far as it is good."""
    at = np.round(np.array(case["t"]) / dt).astype(int)
    good = np.array(case["t"]) <= case["good_until"]
    x = np.stack([mass.x for mass in response.masses])[:, at]
    return np.abs(x - np.array(case["x"]))[:, good]


def check(case, response, dt):
    """Displacements, impacts, peaks and energy at the accuracy that the scheme has at its step."""
    fine = (dt / 0.01) ** 2
    assert errors(case, response, dt).max() < 8e-4 * fine
    # Newton's rebounds that would all be over within a hundredth of a step are not followed.
    found = [impact for impact in response.impacts() if impact.approach_velocity > 2e-3]
    known = [impact for impact in case["impacts"] if impact[2] > 2e-3]
    assert [impact.link for impact in found] == [link for _, link, _ in known]
    for impact, (time, _, speed) in zip(found, known, strict=True):
        assert impact.time == pytest.approx(time, abs=2e-3 * fine)
        assert impact.approach_velocity == pytest.approx(speed, abs=2e-3 * fine)
    demand = response.demand
    if case["peak_force"] is None:
        found_peaks, peaks = [x.peak_impulse for x in demand.links], case["peak_impulse"]
    else:
        found_peaks, peaks = [x.peak_contact for x in demand.links], case["peak_force"]
        depths = [x.peak_penetration for x in demand.links]
        np.testing.assert_allclose(depths, case["peak_penetration"], rtol=2e-3 * fine)
    np.testing.assert_allclose(found_peaks, peaks, rtol=2e-3 * fine)
    gaps = [x.min_gap for x in demand.links]
    np.testing.assert_allclose(gaps, case["min_gap"], atol=2e-4 * fine)
    energy = response.energy
    assert np.abs(energy.residual).max() < 2e-3 * fine * np.abs(energy.input).max()
    lost = float(sum(x.contact_work for x in demand.links))
    assert float(energy.contact_lost[-1]) == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize("name", PAIRS)
def test_pairs(name):
    check(CASES[name], run(CASES[name], 0.01), 0.01)


@pytest.mark.parametrize("name", GROUPS)
def test_rows_and_storeys(name):
    """Links that share masses, stuck at once, stuck in contact, and Newton's rest."""
    check(CASES[name], run(CASES[name], 0.01), 0.01)


@pytest.mark.parametrize("name", ["paper_gap0.2_kelvin_clip_k1000", "random1_newton"])
def test_order_of_convergence_is_two(name):
    case = CASES[name]
    rms = [
        np.sqrt((errors(case, run(case, dt), dt) ** 2).mean()) for dt in (0.02, 0.01, 0.005)
    ]
    orders = np.log2(np.array(rms[:-1]) / rms[1:])
    assert (np.abs(orders - 2) < 0.25).all(), orders


@functools.cache
