"""Derivatives of every scalar by every input: both modes, corners, differences, limits.

A case is a vector of every continuous input: both rods, ρ, ε, μ, the gap and five wavelets; then,
of a record added to them, 100 samples, their interval and a factor.
"""

import dataclasses
from functools import cache, partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings, strategies
from jax.flatten_util import ravel_pytree

import jaxpound as jp
from jaxpound._xla import plan
from tests.made import SCALARS
from tests.reference import convergence_order, paper_gradient
from tests.simulation.pairs import in_unit_of_time

NAMES = [*SCALARS, "soft_min_gap", "pounds"]
OF_LAWS = ["min_gap", "min_gap_time", "slip_distance", "friction_work", "residual_offset"]
OF_LAWS += ["peak_x1", "peak_f2", "peak_acceleration_2"]
"""Scalars that friction laws make, and a peak of each kind, which are alike for all laws."""
SCHEME, GRID = jp.Scheme(), jp.TimeGrid.until(20.0, 0.04)
NOISE = 0.1 * np.random.default_rng(0).normal(size=100)
LANES = 128  # in every batch of the coarse grid, so that each mode of a scheme is compiled once


def vector(structures, ground):
    return np.asarray(ravel_pytree((structures, ground))[0])


def shaken(samples, share=1.0):
    """A share of the paper's wavelets, and a record."""
    ground = jp.paper.ground()
    waves = dataclasses.replace(ground, amplitude=share * ground.amplitude)
    return waves + 2.0 * jp.Record(samples, 0.15, time_unit="1/ω1")


PAPER = vector(jp.paper.structures(), shaken(0 * NOISE))
MU, WAVES = 8, slice(21)  # where μ is, and all but the record
recorded = ravel_pytree((jp.paper.structures(), shaken(NOISE)))[1]
unrecorded = ravel_pytree((jp.paper.structures(), jp.paper.ground()))[1]


def scalars(x, scheme, grid):
    if scheme is not SCHEME:
        demand = jp.demand(*unrecorded(x), grid, scheme, only=OF_LAWS)
        return jnp.stack([getattr(demand, name) for name in OF_LAWS])
    demand = jp.demand(*recorded(x), grid, scheme, temperature=0.05)
    return jnp.stack([demand.scalars()[name] for name in NAMES])


def in_lanes(function):
    """A function over rows, under ``jit`` of ``vmap``."""
    batch = jax.jit(jax.vmap(function))

    def over(*arrays):
        n = len(arrays[0])
        rows = [np.arange(i, i + LANES) % n for i in range(0, n, LANES)]
        return np.concatenate([batch(*(x[some] for x in arrays)) for some in rows])[:n]

    return over


VALUES = in_lanes(lambda x: scalars(x, SCHEME, GRID))
"""From cases to their scalars."""


@cache
def forward(scheme, grid):
    """From a case and a direction to the scalars and their derivatives."""
    of_case = partial(scalars, scheme=scheme, grid=grid)
    return in_lanes(lambda x, d: jnp.stack(jax.jvp(of_case, (x,), (d,))))


@cache
def reverse(scheme, grid):
    """From a case and weights of the scalars to the gradient of the weighted sum."""
    return in_lanes(lambda x, w: jax.vjp(lambda x: scalars(x, scheme, grid), x)[1](w)[0])


def size(x):
    return np.maximum(np.abs(x), 0.1)


def jacobian(x):
    """Scalars and, in forward mode, their derivatives (scalar, input) by inputs over ``size``."""
    y, slopes = forward(SCHEME, GRID)(np.tile(x, (x.size, 1)), np.diag(size(x))).swapaxes(0, 1)
    return y[0], slopes.T


def corners():
    """Every combination of what vanishes, locks or coincides: 72 cases."""
    s, ways = jp.paper.structures(), (False, True)
    combinations = product((0.25, 0.0, 10.0), (None, 1.0), ways, ways, (1.0, 1e-12, 0.0))
    for mu, order, elastic, equal, shaking in combinations:
        rods = [
            jp.ZenerRod(order or rod.order, rod.tau_f, rod.tau_f if elastic else rod.tau_x)
            for rod in (s.rod_1, s.rod_1 if equal else s.rod_2)
        ]
        structures = jp.AdjacentStructures(*rods, 1.0, 1.0 if equal else 2.0, mu, 1.0)
        yield vector(structures, shaken(shaking * NOISE, shaking))


def neighbours(n, seed=0):
    """The paper's case, shaken by a record as well, with every input varied."""
    random, case = np.random.default_rng(seed), vector(jp.paper.structures(), shaken(NOISE))
    x = case * random.uniform(0.8, 1.2, (n, case.size))
    x[:, 0] = random.uniform(0.1, 1.0, n)
    return x


CASES = {
    "event-resolved": (SCHEME, GRID, slice(None)),
    "smoothed": (jp.Scheme(jp.Smoothed(0.01)), GRID, WAVES),
    "paper": (jp.PAPER_SCHEME, jp.TimeGrid(0.04, 200), WAVES),
}


@pytest.mark.parametrize("case", CASES)
def test_both_modes_are_finite_and_adjoint_in_every_corner(case):
    """⟨w, J d⟩ = ⟨Jᵀ w, d⟩; in dense d and w no derivative that is NaN or infinite can hide."""
    scheme, grid, part = CASES[case]
    x = np.concatenate([[*corners()], neighbours(LANES - 72)])[:, part]
    random = np.random.default_rng(1)
    d = random.normal(size=x.shape) * np.where(x == 0, 1.0, np.abs(x))
    w = random.normal(size=(LANES, len(NAMES if scheme is SCHEME else OF_LAWS)))
    y, ahead = forward(scheme, grid)(x, d).swapaxes(0, 1)
    back = reverse(scheme, grid)(x, w)
    assert all(np.isfinite(result).all() for result in (y, ahead, back))
    error = np.abs((w * ahead).sum(1) - (back * d).sum(1)) / np.abs(w * ahead).sum(1)
    # Without friction it is rounding that starts the paper's scheme in stick or in slip.
    sure = (x[:, MU] > 0) | (scheme is not jp.PAPER_SCHEME)
    assert error[sure].max() < 1e-9


def test_forward_equals_reverse_and_batches_single_gradients():
    for x in neighbours(3):
        _, ahead = jacobian(x)
        every = np.eye(len(NAMES))
        back = reverse(SCHEME, GRID)(np.tile(x, (len(NAMES), 1)), every) * size(x)
        largest = np.abs(ahead).max(axis=1, keepdims=True)
        assert (np.abs(ahead - back) <= 1e-9 * np.abs(ahead) + 1e-13 * largest).all()
        assert ((largest > 0).ravel() == [name != "pounds" for name in NAMES]).all()
    # Single gradients with checkpoints, and with steps that are written out.
    only, checked = ("min_gap",), dataclasses.replace(SCHEME, checkpoint=True)
    slope = jax.jit(jax.grad(lambda *case: jp.demand(*case, GRID, checked, only=only).min_gap))
    # In three corners: the paper's rods, those without friction, and nothing but the gap left.
    for x in np.stack([*corners()])[[0, 24, 47]]:
        with plan.chosen(plan.fast):
            alone = slope(*recorded(x))
        together = (jacobian(x)[1][0] / size(x))[: len(jax.tree.leaves(alone))]
        np.testing.assert_allclose(jax.tree.leaves(alone), together, rtol=1e-9, atol=1e-12)
    for x in neighbours(2):
        none, little = (jacobian(np.r_[x[:MU], mu, x[MU + 1 :]])[1] for mu in (0.0, 1e-9))
        largest = np.abs(little).max(axis=1, keepdims=True)
        assert (np.abs(none - little) <= 1e-6 * largest).all()


def floats(*ranges):
    return [strategies.floats(*ends) for ends in ranges]


rods = strategies.builds(
    lambda order, tau_f, ratio: jp.ZenerRod(order, tau_f, tau_f * ratio),
    *floats((0.05, 0.99), (0.01, 1.0), (1.02, 20.0)),
)
ratios = floats((0.3, 3.0), (0.3, 3.0), (0.02, 1.0), (0.1, 2.0))
structures_ = strategies.builds(jp.AdjacentStructures, rods, rods, *ratios)
times = [strategies.lists(x, min_size=5, max_size=5) for x in floats((0.8, 4.0), (0.0, 6.0))]
grounds = strategies.builds(
    lambda amplitude, factor, dt, periods, arrivals, seed: (
        jp.Ricker(amplitude, periods, arrivals)
        + factor * jp.Record(np.random.default_rng(seed).normal(size=100), dt, time_unit="1/ω1")
    ),
    *(*floats((-1.0, 1.0), (-1.0, 1.0), (0.1, 0.2)), *times, strategies.integers(0, 2**32)),
)

ROD = jp.ZenerRod(0.3, 0.1, 1.0)


@settings(max_examples=12)
@given(structures_, grounds)
# Structures that move alike: their friction vanishes, but not its derivatives.
@example(jp.AdjacentStructures(ROD, ROD, 0.5, 2.0, 0.25, 1.0), shaken(NOISE))
def test_derivatives_against_differences(structures, ground):
    """At one time step a scalar is piecewise smooth: pieces end where an event changes its step.

    Differences over 3e-7 of each input seldom reach a piece's end, and rounding costs them 1e-8.
    Where a record's kinks lie on the grid, a second difference, half as long, removes the error of
    the first. What is left was at most 5e-7 in 300 cases. A bend, slopes to either side apart by
    1e-4, is a corner or a jump: 44 of 479,700, at most 1 % of a case. All this in units of the
    scalar's value and steepest slope.
    """
    x, step = vector(structures, ground), 3e-7
    y, slopes = jacobian(x)
    moves = [x + part * step * np.diag(size(x)) for part in (1, -1, 0.5, -0.5)]
    ends = VALUES(np.concatenate(moves)).reshape(4, x.size, y.size)
    up, down, half_up, half_down = (ends - y) / step
    scale = np.abs(slopes).max(axis=1) + np.abs(y) + 1e-3
    bend = np.abs(up + down) / scale
    extrapolated = 2 * (half_up - half_down) - (up - down) / 2
    smooth = bend < 1e-4
    assert np.abs((extrapolated - slopes.T) / scale)[smooth].max() < 2e-6
    assert smooth.mean() > 0.97


LONG = jp.TimeGrid(0.02, 10_000)
"""Until 20 at steps of 0.002, in a unit of time of which 0.02 are one; then nothing follows."""


@jax.jit
def in_unit(unit, directions):
    """Scalars and their derivatives at steps ``unit`` times those of ``LONG``."""

    def of_case(x):
        structures, ground = unrecorded(x)
        system, ground = in_unit_of_time(unit, structures.system(), ground)
        # So narrow that the soft minimum sees nothing of the rest at the end but how long it is.
        demand = jp.demand(system, ground, LONG, temperature=0.02)
        values = jp.Scales(1.0, 1 / unit, unit**-2.0).to_si(demand).scalars()
        values["soft_min_gap"] -= 0.02 * jnp.log(unit)
        return jnp.stack([values[name] for name in NAMES])

    case = jnp.asarray(PAPER[WAVES])
    return jax.vmap(lambda way: jax.jvp(of_case, (case,), (way,)), out_axes=(None, 1))(directions)


@cache
def paper_jacobian(h):
    return jax.device_get(in_unit(h / LONG.dt, np.diag(size(PAPER[WAVES]))))


def gradient_error(derivative):
    """The largest of nine of the smallest gap."""
    return max(abs(ours - true) for ours, true in paper_gradient(derivative).values())


def test_the_paper_s_derivatives_and_every_scalar_converge_at_order_two():
    steps, bounds, errors = [0.02, 0.005, 0.002], [1e-3, 3e-4, 6e-5], []
    for h, bound in zip(steps, bounds, strict=True):
        errors.append(gradient_error(unrecorded(paper_jacobian(h)[1][0] / size(PAPER[WAVES]))[0]))
        assert errors[-1] < bound
    assert convergence_order(steps, errors) > 1.7
    # The gradient by all inputs as one: single derivatives cross their limits on the way. Here the
    # acceleration of block 2 peaks by a jump of friction: its derivatives are rough. The shaking's
    # own peaks are those of the grid by definition.
    steps, runs = [0.02, 0.005], {h: paper_jacobian(h) for h in (0.02, 0.005, 0.002)}
    fine, fine_slopes = runs[0.002]
    # To second order the distance to the fine run goes with h² − 0.002².
    effective = np.sqrt(np.array(steps) ** 2 - 0.002**2)
    for i, name in enumerate(NAMES):
        if name in ("pga", "pgv", "pounds"):
            continue
        errors = [abs(runs[h][0][i] - fine[i]) for h in steps]
        slopes = [np.linalg.norm(runs[h][1][i] - fine_slopes[i]) for h in steps]
        orders = [convergence_order(effective, e) for e in (errors, slopes)]
        rough = name == "peak_acceleration_2"
        assert slopes[-1] / np.linalg.norm(fine_slopes[i]) < (3e-2 if rough else 1e-3)
        assert orders[0] > 1.7 if rough else abs(orders[0] - 2) < 0.1
        assert rough or orders[1] > 1.8


def test_smoothed_friction_s_gradient_tends_to_that_of_coulomb_s_law():
    """The steps resolve every width; an unresolved one has a gradient far off."""
    grid, errors, widths = jp.TimeGrid.until(8.0, 0.0025), [], [0.1, 0.01]
    scheme = jp.Scheme(jp.Smoothed(widths[0]))

    def min_gap(structures, factor):
        """Larger forces and motions are those of a smaller width."""
        scaled = {x: factor * getattr(structures, x) for x in ("friction", "initial_gap")}
        case = dataclasses.replace(structures, **scaled), factor * jp.paper.ground()
        return jp.demand(*case, grid, scheme, only=("min_gap",)).min_gap / factor

    slopes = jax.jit(jax.jacfwd(min_gap))
    for width in widths:
        errors.append(gradient_error(slopes(jp.paper.structures(), widths[0] / width)))
    assert convergence_order(widths, errors) > 0.5
    assert errors[-1] < 7e-3


def test_checkpoints_save_the_memory_of_reverse_mode_and_change_no_derivative():
    """Temporary memory of the compiled gradient: states of about √N instants in place of N."""
    rod = jp.Rod(jp.paper.structures().rod_2, 1.0, (0, jp.GROUND))
    block = jp.System((1.0,), (rod,))
    grid, memory, slopes = jp.TimeGrid(0.00125, 16_000), [], []
    for checkpoint in (True, False):
        scheme = jp.Scheme(checkpoint=checkpoint)

        def peak(system, scheme=scheme):
            return jp.demand(system, jp.paper.ground(), grid, scheme, only=("peak_x1",)).peak_x1

        compiled = jax.jit(jax.grad(peak)).lower(block).compile()
        memory.append(compiled.memory_analysis().temp_size_in_bytes)
        slopes.append(compiled(block))
    # √N of N, with a factor for what a segment holds (benchmarks/batches.py has more lengths).
    assert memory[0] < memory[1] / 20
    for one, other in zip(*map(jax.tree.leaves, slopes), strict=True):
        assert float(one) == pytest.approx(float(other), rel=1e-10, abs=1e-13)
