from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import gamma

import jaxpound as jp
from jaxpound.simulation.rods.zener import nyquist_stiffness
from tests.reference import convergence_order, load
from tests.refusals import refusals

ORDERS = [0.05, 0.23, 0.53, 0.8, 0.95]
MODAL, FULL = jp.ModalHistory(), jp.simulation.FullHistory()
rod_force = jax.jit(jp.study.rod_force, static_argnames=("dt", "order", "history"))


def test_weights_follow_the_gamma_function_and_the_shape_of_the_order():
    j = np.arange(30)
    for order in ORDERS:
        expected = gamma(j - order) / (gamma(-order) * gamma(j + 1))
        np.testing.assert_allclose(jp.simulation.gl_weights(order, 29), expected, rtol=1e-12)
    np.testing.assert_array_equal(
        jp.simulation.gl_weights(1.0, 4), [1, -1, 0, 0, 0]
    )  # backward difference
    weights = jp.simulation.gl_weights(jnp.array([0.2, 0.7]), 5)
    assert weights.shape == (2, 6)
    np.testing.assert_allclose(weights[1], jp.simulation.gl_weights(0.7, 5), rtol=1e-15)


@pytest.mark.parametrize("rod", ["rod_1", "rod_2"])
@pytest.mark.parametrize(("order", "first_sample"), [(1, 1.0), (2, 0.5)])
def test_relaxation_against_the_inverse_laplace_transform(rod, order, first_sample):
    case = load("rods")[rod]
    times, exact = np.array([(float(t), f) for t, f in case["relaxation"].items()]).T
    law = jp.ZenerRod(case["order"], case["tau_f"], case["tau_x"])
    steps, errors = [0.02, 0.01, 0.005], []
    for h in steps:
        x = np.ones(round(20 / h) + 1)
        x[0] = first_sample  # order 2 wants the mean of the two sides of the jump
        force = rod_force(law, x, h, stiffness=case["stiffness"], order=order)
        errors.append(np.abs(np.asarray(force)[np.round(times / h).astype(int)] / exact - 1).max())
    assert errors[-1] < {1: 7e-3, 2: 1e-4}[order]
    assert abs(convergence_order(steps, errors) - order) < 0.15


@pytest.mark.parametrize("order", [1, 2])
def test_rod_force_solves_the_discrete_zener_law_up_to_its_nyquist_stiffness(order):
    """f + τf D f = K (x + τx D x), all at t_m − s h, with D the whole Grünwald–Letnikov sum."""
    rod, h, k = jp.ZenerRod(0.37, 0.1, 2.0), 0.1, 3.0
    x = np.sin(np.linspace(0, 4, 60)) ** 2
    f = np.asarray(rod_force(rod, x, h, stiffness=k, order=order, history=FULL))
    w = np.asarray(jp.simulation.gl_weights(rod.order, 59))
    shift = rod.order / 2 if order == 2 else 0

    def derivative(y):
        return h**-rod.order * np.array([w[: m + 1] @ y[m::-1] for m in range(y.size)])

    def delayed(y):
        return (1 - shift) * y + shift * np.r_[0, y[:-1]]

    left = delayed(f) + rod.tau_f * derivative(f)
    right = k * (delayed(x) + rod.tau_x * derivative(x))
    np.testing.assert_allclose(left, right, rtol=1e-11, atol=1e-12)
    x = (-1.0) ** np.arange(4000)  # the fastest motion
    force = rod_force(rod, x, h, stiffness=k, order=order, history=FULL)
    assert force[-1] / x[-1] == pytest.approx(nyquist_stiffness(rod, k, h, order), rel=1e-3)


def test_elastic_rods_classical_zener_solids_and_rods_in_single_precision():
    """At order 1 a rod under x = 1 relaxes exponentially, f = 1 + (τx/τf − 1) e^(−t/τf)."""
    x = np.sin(np.linspace(0, 9, 500))
    force = rod_force(jp.ZenerRod(0.4, 0.3, 0.3), x, 0.05, stiffness=2.0)
    np.testing.assert_allclose(force, 2 * x, atol=1e-12)
    rod = jp.ZenerRod(0.4, 0.1, 2.0)
    narrow, unit = jax.tree.map(np.float32, rod), np.float32(1)
    force = rod_force(narrow, x.astype(np.float32), 0.02, stiffness=unit)
    assert force.dtype == jnp.float32
    np.testing.assert_allclose(force, rod_force(rod, x, 0.02), atol=2e-4)
    h, x = 0.001, np.r_[0.5, np.ones(3000)]
    force = rod_force(jp.ZenerRod(1.0, 0.5, 2.0), x, h)[1:]
    np.testing.assert_allclose(force, 1 + 3 * np.exp(-h * np.arange(1, 3001) / 0.5), rtol=1e-5)


@partial(jax.jit, static_argnums=(0, 2))
def modal_weights(history, order, n):
    """ω_1 … ω_n: the first as they are, the others by modes from the fifth on."""
    kernel = history.kernel(jnp.asarray(order), n)
    j = np.arange(5, n + 1)
    rates = jnp.concatenate([modes.ahead[:, 1] for modes in kernel])
    weight = jnp.concatenate([modes.weight for modes in kernel])
    later = rates[None] ** (j[:, None] - 5.0) @ weight
    return jnp.concatenate([jp.simulation.gl_weights(order, 4)[1:], later])[:n]


@pytest.mark.parametrize("n", [2, 3, 7, 100, 1000, 10_000])
def test_modal_weights_and_their_slopes_keep_the_tolerance_at_every_order(n):
    history = jp.ModalHistory(tolerance=1e-7)

    def error(order):
        return modal_weights(history, order, n) - jp.simulation.gl_weights(order, n)[1:]

    error_and_slope = jax.jit(lambda order: jax.jvp(error, (order,), (1.0,)))
    for order in [*ORDERS, 0.01, 0.99, 1.0]:
        value, slope = error_and_slope(order)
        assert np.abs(value).sum() < 1.2e-7, (n, order)
        assert np.abs(slope).sum() < 1.2e-7, (n, order)
        bounds = history.error_bounds(order, n)
        assert [np.abs(value).sum(), np.abs(slope).sum()] == pytest.approx(bounds, abs=1e-12)
    np.testing.assert_array_equal(modal_weights(history, 1.0, n)[1:], 0)


def test_the_modal_history_s_error_is_smooth_in_time_and_peaks_have_slopes_without_a_floor():
    """Second differences of the force place a peak's vertex: no blocks of history show there."""
    h, x = 0.0025, np.sin(np.linspace(0, 7, 2001)) ** 2
    rod = jp.ZenerRod(0.95, 0.001, 0.9)
    modal, full = (np.asarray(rod_force(rod, x, h, history=kind)) for kind in (MODAL, FULL))
    error = (modal - full)[50:]
    assert np.abs(np.diff(error, 2)).max() < 0.01 * np.abs(error).max()
    x = np.sin(0.6 * h * np.arange(1601)) ** 2  # its force peaks before its end

    def largest(order, history):
        f = rod_force(jp.ZenerRod(order, 0.0012, 0.888), x, h, history=history)
        i = jnp.argmax(f)
        before, at, after = f[i - 1], f[i], f[i + 1]
        return at - (after - before) ** 2 / (8 * (after - 2 * at + before))

    slope = jax.jit(jax.jacfwd(largest), static_argnums=1)
    assert float(slope(0.947, MODAL)) == pytest.approx(float(slope(0.947, FULL)), rel=1e-6)


def test_more_modes_for_a_longer_run_or_a_smaller_tolerance_but_no_more_memory():
    loose, tight = jp.ModalHistory(tolerance=1e-4), jp.ModalHistory(tolerance=1e-8)
    assert loose.n_modes(1000) < loose.n_modes(100_000) < tight.n_modes(100_000) <= 48
    history = jp.ModalHistory(modes=17)
    assert history.n_modes(1000) == 17
    for n in (100, 1000, 10_000):
        memory = history.empty(history.kernel(jnp.array(0.5), n))
        assert sum(a.size for a in jax.tree.leaves(memory)) == 17


lengths, numbers_of_modes = st.sampled_from([50, 1000]), st.sampled_from([3, 8, 17, 30])


@given(st.floats(0.05, 0.95), lengths, numbers_of_modes, st.integers(0))
def test_the_error_bound_is_never_exceeded_and_can_be_reached(order, n, modes, seed):
    history = jp.ModalHistory(modes=modes)
    bound = history.error_bound(order, n)
    wrong = modal_weights(history, order, n) - np.asarray(jp.simulation.gl_weights(order, n))[1:]
    past = np.random.default_rng(seed % 2**32).normal(size=n)
    rounding = 1e-14 * np.abs(past).max()
    assert abs(wrong @ past) <= bound * np.abs(past).max() + rounding
    assert abs(wrong @ np.sign(wrong)) == pytest.approx(bound, rel=1e-6, abs=1e-13)


@pytest.mark.parametrize("n", [1000, 10_000])
@pytest.mark.parametrize("order", ORDERS)
def test_modal_and_full_history_give_the_same_force(n, order):
    rod, h = jp.ZenerRod(order, 0.1, 2.0), 20 / n
    x = np.cumsum(np.random.default_rng(1).normal(size=n + 1)) / n**0.5
    modal, full = (rod_force(rod, x, h, history=history) for history in (MODAL, FULL))
    # c = τx x − τf f is what the sum runs over; f feeds back on itself by less than 1.
    c = 2.0 * np.abs(x).max() + 0.1 * np.abs(modal).max()
    bound = MODAL.error_bound(order, n) * c / (h**order * (1 - order / 2) + 0.1)
    assert np.abs(modal - full).max() <= 3 * bound + 1e-12


ROD, NINE = jp.ZenerRod(0.5, 1, 2), np.ones(9)
test_bad_input_is_named = pytest.mark.unchecked(
    refusals(
        (lambda: jp.ModalHistory(modes=0), "modes = 0 must be a whole number from 1 to 48"),
        (lambda: jp.ModalHistory(modes=2.5), "modes = 2.5 must be a whole number"),
        (lambda: jp.ModalHistory(tolerance=0.0), "tolerance = 0 must be in"),
        (lambda: jp.ModalHistory(tolerance=float("nan")), "tolerance = nan must be in"),
        (jp.study.rod_force, ROD, [1, 2], 0.1, "number of samples = 2"),
        (jp.study.rod_force, ROD, NINE, 0.0, "dt = 0 must be positive"),
        (lambda: jp.study.rod_force(ROD, NINE, 1, order=3), "order = 3 must be"),
        (jp.study.rod_force, ROD, [1, np.nan, 1], 1, "displacement = nan"),
    )
)
