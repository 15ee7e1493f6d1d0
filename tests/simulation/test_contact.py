"""Runs with contact, against an independent solver that goes from event to event."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import parameters
from tests.reference import convergence_order, load
from tests.refusals import refused
from tests.simulation.contact.test_flows import LAWS
from tests.simulation.pairs import OneOf, in_unit_of_time, padded

CASES = load("contact")["cases"]
PAIRS = [name for name in CASES if not name.startswith(("row3", "storeys"))]
GROUPS = [name for name in CASES if name not in PAIRS]


def law_name(case):
    return case["system"]["links"][0]["law"]


PULLING = ("newton", "kelvin")
WITHOUT_PULL = tuple(sorted({law_name(CASES[name]) for name in PAIRS}.difference(PULLING)))
"""The laws of pairs whose force does not pull: they share a program."""


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
    """Of a case whose pair has a force that does not pull, in the form that shares a program."""
    system, link = system_of(case), case["system"]["links"][0]
    if isinstance(system, jp.AdjacentStructures) and link["law"] in WITHOUT_PULL:
        laws = tuple(LAWS[name](link["k"], link["e"]) for name in WITHOUT_PULL)
        one = OneOf(float(WITHOUT_PULL.index(link["law"])), laws)
        system = dataclasses.replace(system, contact=one)
    return jp.simulate(system, padded(ground_of(case), 5), jp.TimeGrid.until(case["T"], dt=dt))


def errors(case, response, dt):
    """Of the displacements at the reference's instants, as far as it is good."""
    return errors_of_displacements(case, [mass.x for mass in response.masses], dt)


def errors_of_displacements(case, x, dt):
    """Of displacements x, one series for each mass."""
    at = np.round(np.array(case["t"]) / dt).astype(int)
    good = np.array(case["t"]) <= case["good_until"]
    return np.abs(np.asarray(x)[:, at] - np.array(case["x"]))[:, good]


def check(case, response, dt, times=3e-4, speeds=1.5e-3):
    """Displacements, impacts, peaks and energy at the accuracy that the scheme has at its step."""
    fine = (dt / 0.01) ** 2
    assert errors(case, response, dt).max() < 8e-4 * fine
    # Newton's rebounds that would all be over within a hundredth of a step are not followed.
    found = [impact for impact in response.impacts() if impact.approach_velocity > 2e-3]
    known = [impact for impact in case["impacts"] if impact[2] > 2e-3]
    assert [impact.link for impact in found] == [link for _, link, _ in known]
    for impact, (time, _, speed) in zip(found, known, strict=True):
        assert impact.time == pytest.approx(time, abs=times * fine)
        assert impact.approach_velocity == pytest.approx(speed, abs=speeds * fine)
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


@pytest.mark.parametrize("name", CASES)
def test_runs_are_those_of_the_reference(name):
    """Pairs, and groups: links that share masses, stuck at once or in contact, and Newton's rest.

    After many impacts of a group their times and speeds depend strongly on all before.
    """
    within = {"times": 8e-3, "speeds": 8e-3} if name in GROUPS else {}
    check(CASES[name], run(CASES[name], 0.01), 0.01, **within)


def moved(system, name, by):
    """A system with the parameter that the reference calls ``name`` changed."""
    group, element, field = (*name.split("."), "")[:3]
    last = {"m": len(system.masses), "rods": len(system.rods), "links": len(system.links)}[group]
    own = {"gap0": "gap", "mu": "friction", "K": "stiffness", "tf": "material.tau_f"}
    own |= {"tx": "material.tau_x", "e": "contact.restitution", "k": "contact.stiffness"}
    every = range(last) if element == "all" else [int(element) % last]
    place = {"m": "masses.{}"}.get(group, group + ".{}." + own.get(field, ""))
    paths = [place.format(i) for i in every]
    return parameters.put(system, {path: parameters.get(system, path) + by for path in paths})


def derivatives_of_groups(cases, grid):
    """Of peaks and ends by all parameters at the step of ``grid``, and those of the reference.

    Of each case an array (parameters, results); cases of one kind of law share a program.
    """
    names, of = [*cases[0]["derivatives"]], cases[0]["derivatives_of"]
    peak = "peak_contact" if of[0] == "peak_force[0]" else "peak_impulse"

    def outputs(system, ground):
        found = jp.simulate(system, ground, grid)
        peaks = [getattr(link, peak) for link in found.demand.links]
        return jnp.stack([*peaks, *(mass.x[-1] for mass in found.masses)])

    @jax.jit
    def slopes(system, ground):
        ways = [jax.jvp(lambda d, x=x: moved(system, x, d), (0.0,), (1.0,))[1] for x in names]
        along = jax.tree.map(lambda *x: jnp.stack(x), *ways)
        return jax.vmap(lambda t: jax.jvp(lambda s: outputs(s, ground), (system,), (t,))[1])(along)

    results = [j for j, name in enumerate(of) if not name.startswith("max_x")]
    for case in cases:
        known = [np.array(case["derivatives"][name]["value"])[results] for name in names]
        yield np.asarray(slopes(floats(system_of(case)), ground_of(case))), np.array(known)


def test_derivatives_of_rows_are_those_of_the_reference():
    """At h = .005, with Kelvin's law; the others: ``benchmarks/storeys.py --derivatives``."""
    cases = [CASES[name] for name in GROUPS if name.startswith("row3")]
    cases = [case for case in cases if case["system"]["links"][0]["law"] == "kelvin"]
    for found, known in derivatives_of_groups(cases, jp.TimeGrid.until(20.0, dt=0.005)):
        largest = np.abs(known).max(0)
        assert (np.abs(found - known) <= np.maximum(0.01 * np.abs(known), 1e-3 * largest)).all()


def numbers(case):
    """A pair's parameters, by the reference's names."""
    p, (link,), (a, b) = case["parameters"], case["system"]["links"], case["system"]["rods"]
    rods = {"al": a["order"], "be": b["order"], "tfa": a["tf"], "tfb": b["tf"]}
    rods |= {"txa": a["tx"], "txb": b["tx"]}
    own = {"k": link["k"] or 1.0, "e": link["e"]}
    own |= {name: p[name] for name in ("rho", "eps", "mu", "gap0")}
    return {name: float(x) for name, x in (rods | own).items()}


STEPS = (0.02, 0.01, 0.005)
SMOOTH = "paper_gap0.5_kelvin_clip_k1000"
CONVERGING = {"random1_newton": ("newton",), "paper_gap0.2_kelvin_clip_k1000": WITHOUT_PULL}


@functools.cache
def runs_of_pairs(laws):
    """Of all pairs of these laws at the last step, and of those that converge at all, by name.

    By step the displacements, and the derivatives of peak force or impulse and of the ends by all
    parameters. One program takes all, each in a unit of time in which its step is the grid's own.
    """
    peak, power = ("peak_impulse", 1) if laws == ("newton",) else ("peak_contact", 2)
    grid = jp.TimeGrid(STEPS[0], round(20.0 / STEPS[-1]))

    def outputs(differentiated, which, unit, ground):
        p = differentiated
        law = OneOf(which, tuple(LAWS[name](p["k"], p["e"]) for name in laws))
        structures = jp.AdjacentStructures(
            jp.ZenerRod(p["al"], p["tfa"], p["txa"]),
            jp.ZenerRod(p["be"], p["tfb"], p["txb"]),
            *(p[x] for x in ("rho", "eps", "mu", "gap0")),
            law if len(laws) > 1 else law.laws[0],
        )
        response = jp.simulate(*in_unit_of_time(unit, structures.system(), ground), grid)
        x = jnp.stack([mass.x for mass in response.masses])
        highest = getattr(response.demand.links[0], peak) / unit**power
        return jnp.stack([highest, *x[:, jnp.round(20.0 / (grid.dt * unit)).astype(int)]]), x

    slopes_and_x = jax.jit(jax.jacfwd(outputs, has_aux=True))
    runs = {}
    for name in PAIRS:
        if (law := law_name(CASES[name])) in laws:
            by, ground = numbers(CASES[name]), padded(ground_of(CASES[name]), 5)
            runs[name] = {}
            for dt in STEPS if name in (*CONVERGING, SMOOTH) else STEPS[-1:]:
                how = float(laws.index(law)), dt / grid.dt, ground
                runs[name][dt] = jax.device_get(slopes_and_x(by, *how))[::-1]
    return runs


def slopes_of(name, run, fields):
    """Of a pair's peak and ends by these parameters, those of a run and those of the reference."""
    case = CASES[name]
    results = [j for j, x in enumerate(case["derivatives_of"]) if not x.startswith("max_x")]
    reference = [np.array(case["derivatives"][x]["value"])[results] for x in fields]
    return np.array([run[1][x] for x in fields]), np.array(reference)


@pytest.mark.parametrize("name", CONVERGING)
def test_order_of_convergence_is_two(name):
    runs = runs_of_pairs(CONVERGING[name])[name]
    differences = [errors_of_displacements(CASES[name], runs[dt][0], dt) for dt in STEPS]
    rms = [np.sqrt((x**2).mean()) for x in differences]
    orders = np.log2(np.array(rms[:-1]) / rms[1:])
    assert (np.abs(orders - 2) < 0.25).all(), orders


@pytest.mark.parametrize("laws", [("newton",), WITHOUT_PULL], ids=["newton", "forces"])
def test_derivatives_of_pairs_are_those_of_the_reference(laws):
    """Of the peak force or impulse and of the end by all parameters, 12 or fewer, at h = .005."""
    within = []
    for name, runs in runs_of_pairs(laws).items():
        ours, reference = slopes_of(name, runs[STEPS[-1]], CASES[name]["derivatives"])
        error, largest = np.abs(ours - reference), np.abs(reference).max(0)
        within.append(error <= np.maximum(0.01 * np.abs(reference), 1e-3 * largest))
        assert (error <= np.maximum(0.01 * np.abs(reference), 2.5e-3 * largest)).all()
    assert np.concatenate(within).mean() > 0.99


def test_derivatives_converge_at_second_order():
    """Of the end at every halving of the step; of the force, whose peak a step of .02 has only
    three instants for, over all of them."""
    fields = ("gap0", "mu", "e", "k", "rho", "eps", "tfa", "txa", "al")
    errors = []
    for step in STEPS:  # to the finest
        ours, reference = slopes_of(SMOOTH, runs_of_pairs(WITHOUT_PULL)[SMOOTH][step], fields)
        difference = ours - reference
        shares = difference / np.abs(reference).max(0)
        errors.append(np.sqrt((shares**2).mean(0)))
    assert ((np.abs(shares) < 1e-3) | (np.abs(difference) < 0.01 * np.abs(reference))).all()
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (np.abs(orders[:, 1:] - 2) < 0.4).all(), orders
    assert convergence_order(STEPS, np.array(errors)[:, 0]) > 1.6, orders


SHORT = jp.TimeGrid.until(6.0, dt=0.05)
KELVIN = jp.KelvinVoigt(1000.0, 0.65, tension=True)


def struck(law, gap=0.3, **changes):
    return dataclasses.replace(jp.paper.structures(), initial_gap=gap, contact=law, **changes)


def floats(structures, dtype=float):
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), structures)


def short(structures):
    return jp.demand(floats(structures), jp.paper.ground(), SHORT)


def test_single_precision_stays_single():
    structures, ground = floats(struck(KELVIN), jnp.float32), floats(jp.paper.ground(), jnp.float32)
    with pytest.warns(jp.PlausibilityWarning, match="contact is run in float32"):
        found = jp.demand(structures, ground, SHORT)
    assert found.peak_contact.dtype == jnp.float32
    assert found.peak_contact == pytest.approx(float(short(struck(KELVIN)).peak_contact), rel=1e-3)


def test_reverse_mode_is_forward_mode_a_batch_is_a_loop_and_jit_is_eager():
    batch = jax.vmap(lambda gap: floats(struck(KELVIN, gap)))(jnp.array([0.2, 0.4, 2.0]))

    def value(structures):
        demand = short(structures)
        return demand.peak_x1 + demand.contact_work, demand

    values_and_gradients = jax.jit(jax.vmap(jax.value_and_grad(value, has_aux=True)))
    (values, _), gradients = values_and_gradients(batch)
    single = jax.tree.map(lambda x: x[1], batch)
    ones = jax.tree.map(jnp.ones_like, single)
    forward = jax.jit(lambda s, t: jax.jvp(value, (s,), (t,), has_aux=True))
    alone, slope, compiled = forward(single, ones)
    assert values[1] == pytest.approx(float(alone), rel=1e-12)
    total = sum(float(leaf[1]) for leaf in jax.tree.leaves(gradients))
    assert total == pytest.approx(float(slope), rel=1e-9)
    for one, other in zip(jax.tree.leaves(compiled), jax.tree.leaves(short(single)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_smoothed_friction_and_second_derivatives_are_refused():
    newton, smoothed = jp.Newton(0.5), jp.Scheme(jp.Smoothed(0.1))
    pair = struck(newton), jp.paper.ground()
    refused("scheme: friction = Smoothed", jp.demand, *pair, SHORT, smoothed)

    def by_gap(gap):
        return jp.demand(struck(newton, gap), jp.paper.ground(), SHORT).peak_x1

    with pytest.raises(NotImplementedError, match="second derivatives"):
        jax.hessian(by_gap)(0.3)
