"""Runs with contact, against an independent solver that goes from event to event."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import parameters
from tests.reference import LAWS, convergence_order, load
from tests.refusals import refused
from tests.simulation.pairs import OneOf, in_unit_of_time, padded

CASES = load("contact")["cases"]
PAIRS = [name for name in CASES if not name.startswith(("row3", "storeys"))]
GROUPS = [name for name in CASES if name not in PAIRS]


def law_name(case):
    return case["system"]["links"][0]["law"]


PULLING = ("newton", "kelvin")
WITHOUT_PULL = tuple(sorted({law_name(CASES[name]) for name in PAIRS}.difference(PULLING)))
"""The laws of pairs whose force does not pull: they share a program."""


RODS = ("al", "tfa", "txa"), ("be", "tfb", "txb")
"""Names of the numbers of a pair's rods."""


def law_of(link):
    return LAWS[link["law"]](link["k"], link["e"])


def system_of(case):
    """A case's system; the pair in the form that shares its program with other pairs."""
    system = case["system"]
    if "parameters" in case:
        return pair_of(numbers(case), law_of(system["links"][0]))
    materials = [jp.ZenerRod(x["order"], x["tf"], x["tx"]) for x in system["rods"]]
    ends = [(x["K"], (x["b"], x["a"])) for x in system["rods"]]
    rods = tuple(jp.Rod(law, *held) for law, held in zip(materials, ends, strict=True))
    links = (jp.Link((x["a"], x["b"]), x["mu"], x["gap0"], law_of(x)) for x in system["links"])
    return jp.System(tuple(system["m"]), rods, tuple(links))


def numbers(case):
    """A pair's parameters, by the reference's names."""
    p, (link,), (a, b) = case["parameters"], case["system"]["links"], case["system"]["rods"]
    rods = {"al": a["order"], "be": b["order"], "tfa": a["tf"], "tfb": b["tf"]}
    rods |= {"txa": a["tx"], "txb": b["tx"], "k": link["k"] or 1.0, "e": link["e"]}
    rods |= {name: p[name] for name in ("rho", "eps", "mu", "gap0")}
    return {name: float(x) for name, x in rods.items()}


def pair_of(by, law):
    left, right = (jp.ZenerRod(*(by[x] for x in names)) for names in RODS)
    return jp.AdjacentStructures(left, right, *(by[x] for x in ("rho", "eps", "mu", "gap0")), law)


def ground_of(case):
    ricker = case["ricker"]
    return jp.Ricker(ricker["u0"], np.array(ricker["tp"], float), np.array(ricker["ts"], float))


def run(case, dt):
    ground = padded(ground_of(case), 5)
    return jp.simulate(system_of(case), ground, jp.TimeGrid.until(case["T"], dt=dt))


def shared_run(name):
    """A case's run and its step, by a program that other tests need too if there is one."""
    case = CASES[name]
    for laws in (("newton",), WITHOUT_PULL):
        if name in PAIRS and law_name(case) in laws:
            return runs_of_pairs(laws)[name][STEPS[-1]].response, STEPS[-1]
    if name in ROWS:
        return runs_of_rows()[name][-1], ROW_GRID.dt
    return run(case, 0.01), 0.01


def errors(case, response, dt):
    """Of the displacements at the reference's instants, as far as it is good."""
    at = np.round(np.array(case["t"]) / dt).astype(int)
    good = np.array(case["t"]) <= case["good_until"]
    x = np.stack([mass.x for mass in response.masses])
    return np.abs(x[:, at] - np.array(case["x"]))[:, good]


def check(case, response, dt, times=3e-4, speeds=1.5e-3):
    """Displacements, impacts, peaks and energy at the accuracy that the scheme has at its step."""
    fine = (dt / 0.01) ** 2
    assert errors(case, response, dt).max() < 8e-4 * fine
    # Newton's rebounds that would all be over within a hundredth of a step are not followed.
    impacts = [impact for impact in response.impacts() if impact.approach_velocity > 2e-3]
    expected = [impact for impact in case["impacts"] if impact[2] > 2e-3]
    assert [impact.link for impact in impacts] == [link for _, link, _ in expected]
    for impact, (time, _, speed) in zip(impacts, expected, strict=True):
        assert impact.time == pytest.approx(time, abs=times * fine)
        assert impact.approach_velocity == pytest.approx(speed, abs=speeds * fine)
    demand, same = response.demand, {"min_gap": ("min_gap", {"atol": 2e-4 * fine})}
    if case["peak_force"] is None:
        same["peak_impulse"] = "peak_impulse", {"rtol": 2e-3 * fine}
    else:
        same["peak_contact"] = "peak_force", {"rtol": 2e-3 * fine}
        same["peak_penetration"] = "peak_penetration", {"rtol": 2e-3 * fine}
    for field, (name, within) in same.items():
        of_links = [getattr(x, field) for x in demand.links]
        np.testing.assert_allclose(of_links, case[name], **within, err_msg=name)
    energy = response.energy
    assert np.abs(energy.residual).max() < 2e-3 * fine * np.abs(energy.input).max()
    lost = float(sum(x.contact_work for x in demand.links))
    assert float(energy.contact_lost[-1]) == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_runs_are_those_of_the_reference(name):
    """After many impacts of a group their times and speeds depend strongly on all before."""
    within = {"times": 8e-3, "speeds": 8e-3} if name in GROUPS else {}
    check(CASES[name], *shared_run(name), **within)


FIELDS = {"gap0": "gap", "mu": "friction", "K": "stiffness", "tf": "material.tau_f"}
FIELDS |= {"tx": "material.tau_x", "e": "contact.restitution", "k": "contact.stiffness"}


def moved(system, name, by):
    """A system with the parameter that the reference calls ``name`` changed."""
    group, element, *field = name.replace("m.", "masses.").split(".")
    last = len(getattr(system, group))
    every = range(last) if element == "all" else [int(element) % last]
    paths = [".".join([group, str(i), *(FIELDS[x] for x in field)]) for i in every]
    return parameters.put(system, {path: parameters.get(system, path) + by for path in paths})


def derivatives_of_groups(cases, grid):
    """Of peaks and ends by all parameters: ours, the reference's, and the run, of each case."""
    names, of = [*cases[0]["derivatives"]], cases[0]["derivatives_of"]
    peak = "peak_contact" if of[0] == "peak_force[0]" else "peak_impulse"

    def outputs(system, ground):
        response = jp.simulate(system, ground, grid)
        peaks = [getattr(link, peak) for link in response.demand.links]
        return jnp.stack([*peaks, *(mass.x[-1] for mass in response.masses)]), response

    @jax.jit
    def slopes(system, ground):
        ways = [jax.jvp(lambda d, x=x: moved(system, x, d), (0.0,), (1.0,))[1] for x in names]
        along = jax.tree.map(lambda *x: jnp.stack(x), *ways)
        run = functools.partial(outputs, ground=ground)
        push = functools.partial(jax.jvp, run, (system,), has_aux=True)
        return jax.vmap(lambda t: push((t,))[1:], out_axes=(0, None))(along)

    for case in cases:
        ours, response = jax.device_get(slopes(floats(system_of(case)), ground_of(case)))
        yield ours, reference_slopes(case, names), response


def reference_slopes(case, names):
    """The reference's derivatives of peaks and ends by parameters."""
    results = [j for j, x in enumerate(case["derivatives_of"]) if not x.startswith("max_x")]
    return np.array([np.array(case["derivatives"][name]["value"])[results] for name in names])


ROWS = [name for name in GROUPS if name.startswith("row3") and law_name(CASES[name]) == "kelvin"]
ROW_GRID = jp.TimeGrid.until(20.0, dt=0.005)


@functools.cache
def runs_of_rows():
    """By name: derivatives of a row, those of the reference, and the run."""
    each = derivatives_of_groups([CASES[name] for name in ROWS], ROW_GRID)
    return dict(zip(ROWS, each, strict=True))


def test_derivatives_of_rows_are_those_of_the_reference():
    """At h = .005, with Kelvin's law; the others: ``benchmarks/storeys.py --derivatives``."""
    for ours, exact, _ in runs_of_rows().values():
        allowed = np.maximum(0.01 * np.abs(exact), 1e-3 * np.abs(exact).max(0))
        assert (np.abs(ours - exact) <= allowed).all()


STEPS = (0.02, 0.01, 0.005)
SMOOTH = "paper_gap0.5_kelvin_clip_k1000"
CONVERGING = {"random1_newton": ("newton",), "paper_gap0.2_kelvin_clip_k1000": WITHOUT_PULL}
GRID = jp.TimeGrid(STEPS[0], round(20.0 / STEPS[-1]))


class PairRun(NamedTuple):
    """Derivatives of the peak force or impulse and the ends by all parameters, and the run."""

    slopes: dict[str, np.ndarray]
    response: jp.Response


@functools.cache
def program_of_pairs(laws):
    """Derivatives of a pair's results by its numbers, the results, and the run, at any step."""
    peak, power = ("peak_impulse", 1) if laws == ("newton",) else ("peak_contact", 2)

    def outputs(by, which, unit, ground):
        law = OneOf(which, tuple(LAWS[name](by["k"], by["e"]) for name in laws))
        structures = pair_of(by, law if len(laws) > 1 else law.laws[0])
        response = jp.simulate(*in_unit_of_time(unit, structures.system(), ground), GRID)
        x = jnp.stack([mass.x for mass in response.masses])
        highest = getattr(response.demand.links[0], peak) / unit**power
        ends = x[:, jnp.round(20.0 / (GRID.dt * unit)).astype(int)]
        results = jnp.stack([highest, *ends])
        return results, (results, response)

    return jax.jit(jax.jacfwd(outputs, has_aux=True))


@functools.cache
def runs_of_pairs(laws):
    """Of all pairs of these laws at the last step, and of those that converge at all, by name."""
    program, runs = program_of_pairs(laws), {}
    for name in PAIRS:
        if (law := law_name(CASES[name])) in laws:
            by, ground = numbers(CASES[name]), padded(ground_of(CASES[name]), 5)
            runs[name] = {}
            for dt in STEPS if name in (*CONVERGING, SMOOTH) else STEPS[-1:]:
                how = float(laws.index(law)), dt / GRID.dt, ground
                slopes, (_, response) = jax.device_get(program(by, *how))
                scales = jp.Scales(1.0, GRID.dt / dt, (GRID.dt / dt) ** 2)
                runs[name][dt] = PairRun(slopes, scales.to_si(response))
    return runs


def slopes_of(name, run, fields):
    """Of a pair's peak and ends by these parameters, those of a run and those of the reference."""
    return np.array([run.slopes[x] for x in fields]), reference_slopes(CASES[name], fields)


@pytest.mark.parametrize("name", CONVERGING)
def test_order_of_convergence_is_two(name):
    runs = runs_of_pairs(CONVERGING[name])[name]
    differences = [errors(CASES[name], runs[dt].response, dt) for dt in STEPS]
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
    """Of the end at every halving; of the force, of whose peak .02 has three instants, over all."""
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


SHORT, NEWTON = jp.TimeGrid.until(6.0, dt=0.05), jp.Newton(0.65)


def struck(gap=0.3):
    return dataclasses.replace(jp.paper.structures(), initial_gap=gap, contact=NEWTON)


def floats(structures, dtype=float):
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), structures)


def test_jit_is_eager_and_single_precision_stays_single():
    name = "paper_gap0.5_newton_e0.65"
    case, forward = CASES[name], program_of_pairs(("newton",))
    inputs = system_of(case), padded(ground_of(case), 5)
    double = jp.demand(*floats(inputs), GRID)
    _, (_, compiled) = forward(numbers(case), 0.0, 1.0, inputs[1])
    for one, other in zip(*map(jax.tree.leaves, (double, compiled.demand)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)
    with pytest.warns(jp.PlausibilityWarning, match="contact is run in float32"):
        single = jp.demand(*floats(inputs, jnp.float32), GRID)
    assert single.peak_impulse.dtype == jnp.float32
    assert single.peak_impulse == pytest.approx(float(double.peak_impulse), rel=1e-3)


def test_reverse_mode_is_forward_mode_and_a_batch_is_a_loop():
    """Of the largest impulse by all parameters; of a law with a force: ``test_faces.py``."""
    case, forward = CASES["paper_gap0.5_newton_e0.65"], program_of_pairs(("newton",))
    ground, every = padded(ground_of(case), 5), [numbers(case) | {"gap0": x} for x in (0.2, 2.0)]

    def impulse(by):
        only = ("peak_impulse",)
        return jp.demand(pair_of(by, jp.Newton(by["e"])), ground, GRID, only=only).peak_impulse

    backwards = jax.jit(jax.vmap(jax.value_and_grad(impulse)))
    batch = jax.tree.map(lambda *x: np.stack(x), *every)
    for lane, by in enumerate(every):
        slopes, ((expected, *_), _) = jax.device_get(forward(by, 0.0, 1.0, ground))
        value, gradient = jax.tree.map(lambda x, i=lane: x[i], jax.device_get(backwards(batch)))
        assert value == pytest.approx(float(expected), rel=1e-12)
        rounding = 1e-9 * max(abs(slope[0]) for slope in slopes.values())
        assert gradient == pytest.approx({x: float(y[0]) for x, y in slopes.items()}, abs=rounding)
    assert value == 0


def test_smoothed_friction_and_second_derivatives_are_refused():
    smoothed = jp.Scheme(jp.Smoothed(0.1))
    refused("scheme: friction = Smoothed", jp.demand, struck(), jp.paper.ground(), SHORT, smoothed)

    def by_gap(gap):
        return jp.demand(struck(gap), jp.paper.ground(), SHORT, only=("peak_x1",)).peak_x1

    with pytest.raises(NotImplementedError, match="second derivatives of a run with contact"):
        jax.jacfwd(jax.grad(by_gap))(0.3)
