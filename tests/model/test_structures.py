"""Fractional Zener rods and the pair of structures on them."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, strategies
from numpy.testing import assert_allclose

import jaxpound as jp
from tests.made import log_uniform
from tests.refusals import refusals, refused

orders = strategies.floats(0.01, 1.0)
taus = log_uniform(1e-4, 1e3)
ratios = strategies.just(1.0) | log_uniform(1.0, 1e5)
frequencies = log_uniform(1e-5, 1e5)
zener_rods = strategies.builds(lambda g, tau, r: jp.ZenerRod(g, tau, tau * r), orders, taus, ratios)


def modulus(rod, omega):
    """K*(iω) of the law f + τ_f D^γ f = x + τ_x D^γ x, in complex arithmetic."""
    z = (1j * omega) ** rod.order
    return (1 + rod.tau_x * z) / (1 + rod.tau_f * z)


def structures(**changes):
    values = {"rod_1": jp.ZenerRod(0.23, 0.004, 1.183), "rod_2": jp.ZenerRod(0.53, 0.2, 4.0)}
    values |= {"mass_ratio": 1.5, "stiffness_ratio": 2.0, "friction": 0.25, "initial_gap": 1.0}
    return jp.AdjacentStructures(**(values | changes))


def test_moduli_are_those_of_slow_and_fast_motion_and_take_arrays():
    for order in (0.3, 0.8, 1.0):
        rod = jp.ZenerRod(order, 0.1, 2.0)
        assert rod.instantaneous_modulus == 2.0 / 0.1
        assert rod.storage_modulus(0.0) == 1
        slow, *fast = 1e-18 ** (1 / order), 1e18 ** (1 / order), 1e250
        for omega, limit in ((slow, 1.0), *((omega, 2.0 / 0.1) for omega in fast)):
            assert rod.storage_modulus(omega) == pytest.approx(limit, rel=1e-15)
            assert rod.loss_modulus(omega) == pytest.approx(0, abs=1e-15)
    rod = jp.ZenerRod(0.5, 0.1, 2.0)
    omega = np.array([[0.5, 1.0, 2.0], [3.0, 4.0, 5.0]])
    assert_allclose(rod.complex_modulus(omega), modulus(rod, omega), rtol=1e-14)
    assert_allclose(rod.loss_modulus([3, 4]), modulus(rod, omega[1, :2]).imag, rtol=1e-13)


@given(zener_rods, frequencies, strategies.floats(1.0, 100.0))
@example(jp.ZenerRod(1, 0.1, 2.0), 3.0, 2.0)  # the classical solid
def test_moduli_are_those_of_the_law_in_complex_arithmetic(rod, omega, faster):
    """Rods take energy and stiffen with frequency."""
    expected, storage = modulus(rod, omega), rod.storage_modulus(omega)
    loss, factor = rod.loss_modulus(omega), expected.imag / expected.real
    assert_allclose(rod.complex_modulus(omega), expected, rtol=1e-13)
    assert_allclose(storage, expected.real, rtol=1e-13)
    assert_allclose(loss, expected.imag, rtol=1e-11, atol=1e-13 * abs(expected))
    assert_allclose(rod.loss_factor(omega), factor, rtol=1e-11, atol=1e-13)
    assert loss >= 0
    assert 1 <= storage <= rod.instantaneous_modulus * (1 + 1e-14)
    assert rod.storage_modulus(faster * omega) >= storage * (1 - 1e-14)


@given(orders, taus, frequencies)
def test_equal_relaxation_times_make_an_elastic_rod(order, tau, omega):
    rod = jp.ZenerRod(order, tau, tau)
    moduli = rod.storage_modulus(omega), rod.loss_modulus(omega)
    assert (*moduli, rod.damping_ratio(stiffness=omega)) == (1, 0, 0)
    assert rod.natural_frequency(8.0, 2.0) == pytest.approx(2.0, rel=1e-15)  # as in textbooks
    assert rod.natural_frequency() == pytest.approx(1.0, rel=1e-15)


@given(zener_rods, log_uniform(1e-3, 1e10), log_uniform(1e-3, 1e7))
@example(jp.ZenerRod(1.0, 0.01, 100.0), 1.0, 1.0)  # stiffens almost as ω²
@example(jp.ZenerRod(1.0, 1e-3, 1e3), 1.0, 1.0)
@example(jp.ZenerRod(0.5, 0.1, 0.1), 2.0, 3.0)
def test_natural_frequency_and_damping_ratio_are_those_of_the_modulus(rod, stiffness, mass):
    omega = float(rod.natural_frequency(stiffness, mass))
    at_rest = modulus(rod, omega)
    assert mass * omega**2 == pytest.approx(stiffness * at_rest.real, rel=1e-12)
    zeta = rod.damping_ratio(stiffness, mass)
    assert zeta == pytest.approx(at_rest.imag / at_rest.real / 2, rel=1e-9, abs=1e-13)


def test_pair_reports_both_uncoupled_structures_and_batches_are_the_single_ones():
    pair = structures(mass_ratio=3.0, stiffness_ratio=2.0)
    omega_1, omega_2 = (float(omega) for omega in pair.natural_frequencies)
    # Eq. (9) without ground and friction: x1'' = −f1 and x2'' = −ρ f2, with f2 in units of ε.
    assert omega_1**2 == pytest.approx(modulus(pair.rod_1, omega_1).real, rel=1e-13)
    assert omega_2**2 == pytest.approx(3.0 * 2.0 * modulus(pair.rod_2, omega_2).real, rel=1e-13)
    blocks = zip(pair.damping_ratios, (pair.rod_1, pair.rod_2), (omega_1, omega_2), strict=True)
    for zeta, rod, omega in blocks:
        at_rest = modulus(rod, omega)
        assert zeta == pytest.approx(at_rest.imag / at_rest.real / 2, rel=1e-12)
    slope = jax.jit(jax.grad(lambda tau_x: jp.ZenerRod(0.7, 0.01, tau_x).natural_frequency()))
    h = 1e-5
    difference = (slope(2.0 + h) - slope(2.0 - h)) / (2 * h)
    assert jax.jit(jax.grad(slope))(2.0) == pytest.approx(float(difference), rel=1e-6)
    parameters = np.array([[0.2, 0.01, 1.0], [0.5, 0.1, 0.1], [1.0, 0.5, 3.0]])
    batch = jp.ZenerRod(*parameters.T)
    for quantity in map(jax.jit, QUANTITIES.values()):
        single = [quantity(jp.ZenerRod(*row)) for row in parameters]
        assert_allclose(quantity(batch), single, rtol=1e-14)
        assert_allclose(jax.jit(jax.vmap(quantity))(batch), single, rtol=1e-14)
    pair = structures(rod_2=jp.ZenerRod(1, 1, 1), mass_ratio=2, stiffness_ratio=8)
    gradient = jax.jit(jax.grad(lambda s: s.natural_frequencies[1]))(pair)
    # The elastic block 2 has ω = √(ρ ε).
    assert gradient.mass_ratio == pytest.approx(1.0, rel=1e-13)
    assert gradient.stiffness_ratio == pytest.approx(0.25, rel=1e-13)
    rod = jp.ZenerRod(*np.array([0.5, 0.1, 2.0], np.float32))
    omega = rod.natural_frequency()
    assert omega.dtype == jnp.float32
    assert rod.complex_modulus(omega).dtype == jnp.complex64
    assert omega**2 == pytest.approx(modulus(rod, float(omega)).real, rel=1e-6)


def test_pairs_and_frequencies_refuse_bad_values():
    for bad in (0.0, -1.0, np.nan, "a", None):
        rod = jp.ZenerRod(0.5, 0.1, 2.0)
        refused("ZenerRod.natural_frequency: stiffness = ", rod.natural_frequency, stiffness=bad)
        refused("ZenerRod.damping_ratio: mass = ", rod.damping_ratio, mass=bad)
    for names, values, message in (
        (RATIOS, (0, -1.5, np.nan, np.inf, [1.0, -1.0]), "positive and finite"),
        (FORCES, (-1e-9, np.nan, np.inf, [0.0, -1.0]), "and not negative"),
        (RATIOS + FORCES, (None, "2", True, 2j), "must be a real number"),
        (("rod_1", "rod_2"), (None, 0.5, (0.5, 0.1, 2.0), structures()), "of type ZenerRod"),
        (("contact",), (3.0, "newton", jp.Newton, ROD), "of type ContactLaw or"),
    ):
        for name, bad in itertools.product(names, values):
            refused(f"AdjacentStructures: {name} = .* ?{message}", structures, **{name: bad})
    for law in (None, jp.Newton(0.65), jp.HertzDamped(2e4, 0.65)):
        (link,) = structures(contact=law).system().links
        assert (link.contact, link.gap, link.friction) == (law, 1.0, 0.25)
    gradient = jax.grad(lambda s: s.system().links[0].contact.stiffness ** 2)
    assert gradient(structures(contact=jp.Hertz(3.0))).contact.stiffness == 6.0
    jp.ZenerRod(1, 0.1, 0.1)
    structures(friction=0, initial_gap=0)


QUANTITIES = {
    "storage": lambda rod: rod.storage_modulus(1.7),
    "loss": lambda rod: rod.loss_modulus(1.7),
    "frequency": lambda rod: rod.natural_frequency(3.0, 0.5),
    "damping": lambda rod: rod.damping_ratio(3.0, 0.5),
}


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_gradients_agree_with_central_differences(quantity):
    f = jax.jit(lambda p: quantity(jp.ZenerRod(*p)))
    gradient = jax.jit(jax.grad(f))
    for at in ([0.3, 0.1, 2.0], [1.0, 0.1, 2.0], [0.6, 0.5, 0.5], [1.0, 0.01, 50.0]):
        point = np.array(at)  # traced, it may step out of the rules: the formulas go on smoothly
        steps = 1e-5 * np.diag(point)
        differences = [float(f(point + d) - f(point - d)) / (2 * d.sum()) for d in steps]
        assert_allclose(gradient(point), differences, rtol=1e-7, atol=1e-8)


test_rod_refuses_bad_values = refusals(
    ({"order": 0}, r"order = 0 must be in \(0, 1\]"),
    ({"order": 1.5}, r"order = 1\.5 must be in \(0, 1\]"),
    ({"order": np.nan}, r"order = nan must be in \(0, 1\]"),
    ({"order": "0.5"}, "order = '0.5' must be a real number"),
    ({"order": None}, "order = None must be a real number"),
    ({"order": True}, "order = True must be a real number"),
    ({"order": 0.5j}, "order = 0.5j must be a real number"),
    ({"order": [0.5, 2.0]}, r"order = 2 \(at index \[1\]\) must be in \(0, 1\]"),
    ({"tau_f": 0.0}, "tau_f = 0 must be positive and finite"),
    ({"tau_f": -0.1}, r"tau_f = -0\.1 must be positive and finite"),
    ({"tau_f": np.nan}, "tau_f = nan must be positive and finite"),
    ({"tau_f": [0.1, -1.0]}, r"tau_f = -1 \(at index \[1\]\) must be positive"),
    ({"tau_x": 0.05}, r"tau_x = 0\.05 must be finite and at least tau_f = 0\.1"),
    ({"tau_x": np.inf}, "tau_x = inf must be finite and at least tau_f"),
    ({"tau_x": [1.0, 0.01]}, r"tau_x = 0\.01 \(at index \[1\]\) must be finite and at least"),
    ({"tau_f": [0.1, 3.0]}, r"tau_x = 2 \(at index \[1\]\) must be finite and at least tau_f"),
    ({"tau_f": np.array(3.0)}, "tau_x = 2 must be finite and at least tau_f = 3 "),
    ({"order": [0.5, 0.6], "tau_f": [0.1] * 3}, r"order \(2,\), tau_f \(3,\), tau_x \(\)"),
    of=lambda changes: jp.ZenerRod(**({"order": 0.5, "tau_f": 0.1, "tau_x": 2.0} | changes)),
    before="^ZenerRod: .*",
)

RATIOS, FORCES = ("mass_ratio", "stiffness_ratio"), ("friction", "initial_gap")
ROD = jp.ZenerRod(0.5, 0.1, 2.0)


def test_structures_are_traced_and_mapped():
    def build(x):
        rod = jp.ZenerRod(x, x, x)
        return structures(rod_1=rod, mass_ratio=x, stiffness_ratio=x, friction=x, initial_gap=x)

    for bad in (jnp.nan, -1.0, jnp.inf):
        assert type(jax.jit(build)(bad)) is jp.AdjacentStructures
        assert jax.vmap(build)(jnp.full(3, bad)).friction.shape == (3,)
        assert jax.grad(lambda x: build(x).friction)(bad) == 1
    frictions, paths = jnp.array([0.1, 0.2, 0.3]), jax.tree_util.tree_map_with_path
    keystr = jax.tree_util.keystr
    pair = paths(lambda p, x: frictions if keystr(p) == ".friction" else x, structures())
    axes = paths(lambda p, x: 0 if keystr(p) == ".friction" else None, pair)

    def doubled(s):
        return jax.tree.map(lambda x: 2.0 * x, s)

    result = jax.vmap(doubled, in_axes=(axes,), out_axes=axes)(pair)
    assert type(result) is jp.AdjacentStructures
    assert_allclose(result.friction, [0.2, 0.4, 0.6])
    assert jnp.shape(result.rod_1.order) == ()
    assert jax.vmap(doubled, in_axes=(axes,))(pair).rod_1.order.shape == (3,)


def test_every_parameter_is_a_leaf_with_a_path_and_gradients_and_replacements_are_structures():
    leaves = jax.tree_util.tree_leaves_with_path(structures())
    names = [f".{rod}.{x}" for rod in ("rod_1", "rod_2") for x in ("order", "tau_f", "tau_x")]
    names += [f".{x}" for x in RATIOS + FORCES]
    assert [jax.tree_util.keystr(path) for path, _ in leaves] == names
    assert [leaf for _, leaf in leaves] == [0.23, 0.004, 1.183, 0.53, 0.2, 4.0, 1.5, 2.0, 0.25, 1.0]
    gradient = jax.grad(lambda s: s.mass_ratio * s.friction + s.rod_2.tau_x**2)(structures())
    assert (type(gradient), type(gradient.rod_2)) == (jp.AdjacentStructures, jp.ZenerRod)
    assert (gradient.mass_ratio, gradient.friction, gradient.rod_2.tau_x) == (0.25, 1.5, 8.0)
    assert (gradient.initial_gap, gradient.rod_1.order) == (0.0, 0.0)
    pair = structures()
    assert dataclasses.replace(pair, friction=0.5).friction == 0.5
    assert pair.friction == 0.25
    refused("friction = -1", dataclasses.replace, pair, friction=-1.0)
    refused(r"tau_x = 0\.001", dataclasses.replace, pair.rod_1, tau_x=0.001)
    for frozen, name in ((pair, "friction"), (pair.rod_1, "order")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(frozen, name, 1.0)
    # Rebuilding takes any leaf.
    structure = jax.tree.structure(structures())
    for leaf in (None, object(), -1.0, "text"):
        rebuilt = jax.tree.unflatten(structure, [leaf] * structure.num_leaves)
        assert (type(rebuilt), type(rebuilt.rod_2)) == (jp.AdjacentStructures, jp.ZenerRod)
        assert rebuilt.rod_2.tau_x is rebuilt.friction is leaf
        repr(rebuilt)
