"""Contact laws: their forces, what a free collision returns, and what is refused."""

import dataclasses
import itertools
from decimal import Decimal, localcontext
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma

import jaxpound as jp
from jaxpound import Hertz, HertzDamped, Jankowski, KelvinVoigt, Newton
from jaxpound.model.contact import may_pull, with_mass
from tests.reference import LAWS, load
from tests.refusals import refusals

COLLISIONS = [case for case in load("contact")["collisions"] if case["law"] != "newton"]
BY_NAME = {case["law"]: LAWS[case["law"]](1000.0, 0.65) for case in COLLISIONS}
named = pytest.mark.parametrize("law", BY_NAME.values(), ids=BY_NAME)


@jax.jit
def pressing(law, x, v, speed):
    p = law.force(x, v, speed)
    return p if may_pull(law) else jnp.maximum(p, 0.0)


def collision(law, mass, speed):
    """Time, penetration and rate of a free collision, until the penetration has gone."""
    massive = with_mass(law, mass)

    def left(_, state):
        return state[0]

    left.terminal, left.direction = True, -1
    scale = speed * np.sqrt(mass / 1e3)
    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-11 * scale, "dense_output": True}
    run = solve_ivp(
        lambda _, state: (state[1], -float(pressing(massive, *state, speed)) / mass),
        *((0.0, 100.0), (0.0, speed)),
        events=left,
        **options,
    )
    assert run.status == 1
    return run


def test_a_free_collision_returns_what_the_law_is_known_to_return():
    for case in COLLISIONS:
        run = collision(LAWS[case["law"]](case["k"], case["e"]), 1 / (1 / 1.0 + 1 / 0.6), 1.0)
        returned = pytest.approx(case["restitution"], abs=1e-6)
        assert -run.y[1, -1] == returned, case
        deepest = run.sol(np.linspace(0, run.t[-1], 4001))[0].max()
        assert deepest == pytest.approx(case["peak_penetration"], rel=1e-6), case
        if case["e"] == 0.65:  # the same of another stiffness, mass and speed
            run = collision(LAWS[case["law"]](37.0, 0.65), 2.5, 0.3)
            assert -run.y[1, -1] / 0.3 == returned, case
    mass, stiffness, speed = 0.375, 1e4, 1.0
    run = collision(Hertz(stiffness), mass, speed)
    deepest = (5 * mass * speed**2 / (4 * stiffness)) ** 0.4
    assert run.sol(run.t[-1] / 2)[0] == pytest.approx(deepest, rel=1e-8)
    lasts = 0.8 * np.sqrt(np.pi) * gamma(0.4) / gamma(0.9) * deepest / speed
    assert run.t[-1] == pytest.approx(lasts, rel=1e-9)


def test_forces_by_hand():
    d, w, v0, m = 0.04, -0.3, 0.5, 2.0
    hertz = 1000.0 * d**1.5
    xi = np.log(1 / 0.65) / np.hypot(np.pi, np.log(0.65))
    expected = {
        "kelvin_clip": 1000.0 * d + 2 * xi * np.sqrt(1000.0 * m) * w,
        "hertz": hertz,
        "hertzdamp": hertz * (1 + 0.75 * (1 - 0.65**2) * w / v0),
        "hertzdamp_flores": hertz * (1 + 8 * 0.35 / (5 * 0.65) * w / v0),
        "hertzdamp_hc": hertz * (1 + 1.5 * 0.35 * w / v0),
        "jankowski": hertz,
    }
    for name, p in expected.items():
        assert with_mass(BY_NAME[name], m).force(d, w, v0) == pytest.approx(p, rel=1e-14), name
    xi = 4.5 * np.sqrt(5) * (1 - 0.65**2) / (0.65 * (0.65 * (9 * np.pi - 16) + 16))
    p = hertz + 2 * xi * np.sqrt(1000.0 * np.sqrt(d) * m) * 0.3
    assert with_mass(BY_NAME["jankowski"], m).force(d, 0.3, v0) == pytest.approx(p, rel=1e-14)


@named
def test_the_elastic_part_is_the_force_at_rest_and_without_penetration_there_is_none(law):
    power = 1.0 if isinstance(law, KelvinVoigt) else 1.5
    for d in (1e-6, 0.01, 3.0):
        elastic = pytest.approx(1000.0 * d**power, rel=1e-13)
        assert with_mass(law, 0.4).force(d, 0.0, 0.7) == elastic
        if not isinstance(law, Hertz):
            lossless = dataclasses.replace(law, restitution=1.0)
            assert with_mass(lossless, 0.4).force(d, 0.7, 0.7) == elastic
    force = with_mass(law, 0.4).force
    for d, w in itertools.product((0.0, -0.2), (-1.0, 0.0, 1.0)):
        slopes = jax.grad(force, argnums=(0, 1, 2))(d, w, 1.0)
        if isinstance(law, KelvinVoigt):
            damping = 2 * law.damping_ratio * np.sqrt(1000.0 * 0.4)
            assert force(d, w, 1.0) == pytest.approx(float(1000.0 * d + damping * w), rel=1e-14)
            assert slopes == pytest.approx((1000.0, float(damping), 0.0), rel=1e-14)
        else:
            assert (force(d, w, 1.0), *slopes) == (0.0,) * 4


@named
def test_every_derivative_is_finite_at_any_state(law):
    def force(law, mass, *state):
        return with_mass(law, mass).force(*state)

    slopes = jax.jit(jax.grad(force, argnums=(0, 1, 2, 3, 4)))
    states = (-1.0, 0.0, 1e-30, 1e-3, 10.0), (-2.0, 0.0, 2.0), (0.0, 1.0)
    precisions, restitutions = (jnp.float32, jnp.float64), (1e-3, 0.5, 1.0)
    for dtype, e, *state in itertools.product(precisions, restitutions, *states):
        with_e = jax.tree.map(lambda x, e=e: e if x < 1 else x, law)
        derivatives = jax.tree.leaves(slopes(*jax.tree.map(dtype, (with_e, 0.4, *state))))
        assert all(np.isfinite(x) for x in derivatives), (e, state)
        assert {x.dtype for x in derivatives} == {np.dtype(dtype)}


@named
def test_a_law_keeps_precision_and_batches_and_is_elastic_where_blocks_touch_at_rest(law):
    if isinstance(law, HertzDamped):
        assert law.force(0.1, 0.3, 0.0) == Hertz(1000.0).force(0.1, 0.3, 0.0)
    else:
        assert law.force(0.1, 0.3, 0.0) == law.force(0.1, 0.3, 2.0)
    exact = with_mass(law, 0.4).force(0.01, 0.3, 1.0)
    for one in (law, jax.tree.map(np.float32, law)):
        p = with_mass(one, jnp.float32(0.4)).force(*jnp.float32([0.01, 0.3, 1.0]))
        assert p.dtype == jnp.float32
        assert p == pytest.approx(float(exact), rel=1e-5)
    if isinstance(law, Hertz):
        batch = Hertz([500.0, 1000.0, 2000.0])
        each = [Hertz(k) for k in batch.stiffness]
    else:
        batch = dataclasses.replace(law, restitution=[0.3, 0.65, 1.0])
        each = [dataclasses.replace(law, restitution=e) for e in batch.restitution]
    single = [with_mass(one, 0.4).force(0.01, 0.3, 1.0) for one in each]
    np.testing.assert_allclose(with_mass(batch, 0.4).force(0.01, 0.3, 1.0), single, rtol=1e-14)


def test_the_force_itself_is_that_of_effective_mass_1_and_only_kelvin_s_may_pull():
    for law in BY_NAME.values():
        assert isinstance(law, jp.model.ContactLaw)
        assert isinstance(with_mass(law, 0.4), jp.model.ContactLaw)
        assert law.force(0.01, 0.3, 1.0) == with_mass(law, 1.0).force(0.01, 0.3, 1.0)
        tension = isinstance(law, KelvinVoigt) and law.tension
        assert may_pull(law) is may_pull(with_mass(law, 0.4)) is tension
    assert not may_pull(Newton(0.5))
    assert not isinstance(Newton(0.5), jp.model.ContactLaw)
    assert [with_mass(law, 0.4) is law for law in (BY_NAME["kelvin"], Hertz(1.0))] == [False, True]


@partial(jax.jit, static_argnames="damping")
def factor(restitution, damping="exact"):
    return HertzDamped(1.0, restitution, damping).damping_factor


slope_of = jax.jit(jax.grad(factor), static_argnames="damping")


def equation(z, e):
    """Z (1 + e) − ln((1 + Z)/(1 − Z e))."""
    return z * (1 + e) - ((1 + z) / (1 - z * e)).ln()


OF_DAMPED = "HertzDamped: damping = "
DAMPINGS = ("exact", "muthukumar", "ye", "hunt-crossley")
NEAR_ONE = [1 - 10.0**-n for n in (2, 4, 8, 12)]


def test_the_exact_z_solves_its_equation_to_rounding_with_derivatives():
    for e in (0.001, 0.01, 0.1, 0.2, 0.36, 0.38, 0.5, 0.65, 0.9, *NEAR_ONE):
        z = float(factor(e))
        with localcontext() as context:
            context.prec = 60 + round(0.5 / e)  # 1 − Z e is exp(−1/e)
            e, root = Decimal(e), Decimal(z)
            low, high = root * (1 - Decimal("2e-15")), root * (1 + Decimal("2e-15"))
            assert equation(low, e) > 0
            assert high * e >= 1 or equation(high, e) < 0
    for dtype in (float, jnp.float32):
        assert factor(dtype(1.0)) == 0.0
        assert slope_of(dtype(1.0)) == pytest.approx(-1.5, rel=1e-6)
    difference = float(slope_of(0.65 + 1e-5) - slope_of(0.65 - 1e-5)) / 2e-5
    assert jax.jit(jax.grad(slope_of))(0.65) == pytest.approx(difference, rel=1e-8)
    # To first order in 1 − e; Ye's is larger by 16/15.
    loss = 1e-6
    for damping, first in (("muthukumar", 1.5), ("ye", 1.6), ("hunt-crossley", 1.5)):
        assert factor(1 - loss, damping) == pytest.approx(first * loss, rel=1e-5)
    assert factor(1 - loss) == pytest.approx(1.5 * loss, rel=1e-5)
    for damping in DAMPINGS:
        of_law = partial(factor, damping=damping)
        slopes_of = jax.jit(lambda e, f=of_law: (jax.grad(f)(e), jax.jacfwd(f)(e)))
        for e in (0.001, 0.05, 0.37, 0.65, 0.95):
            h = 1e-4 * e
            f = [float(factor(e + i * h, damping)) for i in (-2, -1, 1, 2)]
            difference = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
            for slope in slopes_of(e):
                assert slope == pytest.approx(difference, rel=1e-9, abs=1e-15 * f[0] / h)


test_a_law_refuses_bad_values = refusals(
    (lambda: Newton(0.0), r"Newton: restitution = 0 must be in \(0, 1\]"),
    (lambda: Newton(1.01), r"Newton: restitution = 1\.01 must be in \(0, 1\]"),
    (lambda: Newton(np.nan), r"Newton: restitution = nan must be in \(0, 1\]"),
    (lambda: Newton("0.5"), "Newton: restitution = '0.5' must be a real number"),
    (lambda: KelvinVoigt(0.0, 0.5), "KelvinVoigt: stiffness = 0 must be positive and fin"),
    (lambda: KelvinVoigt(1.0, -0.5), r"KelvinVoigt: restitution = -0\.5 must be in"),
    (lambda: KelvinVoigt(1.0, 0.5, 1), "KelvinVoigt: tension = 1 must be True or False"),
    (lambda: KelvinVoigt([1.0, 2.0], [0.5] * 3), r"KelvinVoigt: .* \(2,\), .* one batch"),
    (lambda: Hertz(np.inf), "Hertz: stiffness = inf must be positive and finite"),
    (lambda: Hertz([1.0, -1.0]), r"Hertz: stiffness = -1 \(at index \[1\]\) must be"),
    (lambda: HertzDamped(1.0, 1.5), r"HertzDamped: restitution = 1\.5 must be in"),
    (HertzDamped, 1.0, 0.5, "exat", f"{OF_DAMPED}'exat' must be .*; did you mean 'exact'?"),
    (HertzDamped, 1.0, 0.5, None, f"damping = None must be .*; allowed: {', '.join(DAMPINGS)}"),
    (lambda: HertzDamped(1.0, 0.5, ["ye"]), r"HertzDamped: damping = \['ye'\] must be"),
    (lambda: Jankowski(-1.0, 0.5), "Jankowski: stiffness = -1 must be positive and finite"),
    (lambda: Jankowski(1.0, 2.0), "Jankowski: restitution = 2 must be in"),
)


def test_traced_values_never_raise_and_numbers_are_leaves():
    for law in BY_NAME.values():
        for bad in (jnp.nan, -1.0, 0.0):
            made = jax.jit(lambda x, law=law: jax.tree.map(lambda _: x, law))(bad)
            assert type(made) is type(law)
    batch = jax.vmap(lambda e: KelvinVoigt(1.0, e))(jnp.array([0.5, -1.0]))
    np.testing.assert_array_equal(batch.restitution, [0.5, -1.0])
    assert jax.tree.leaves(KelvinVoigt(100, 0.5, tension=np.True_)) == [100.0, 0.5]
    soft, hard = HertzDamped(1.0, 0.5, "ye"), HertzDamped(2.0, 0.5, "ye")
    assert jax.tree.structure(soft) == jax.tree.structure(hard)
    assert jax.tree.structure(soft) != jax.tree.structure(HertzDamped(1.0, 0.5))
    assert hash(jax.tree.structure(KelvinVoigt(1.0, 0.5)))


def test_a_floor_s_stiffness_is_axial_and_a_storey_s_is_twenty_times_the_stiffer_one():
    assert jp.contact_stiffness(modulus=30e9, area=2.0, length=15.0) == 4e9
    for storeys in ((3.0, 7.0), (7.0, 3.0), [7, 7], np.array([2.0, 7.0])):
        assert jp.contact_stiffness(storeys=storeys) == 140.0
    stiffer = jax.grad(lambda k: jp.contact_stiffness(storeys=k))
    np.testing.assert_array_equal(stiffer(jnp.array([3.0, 7.0])), [0.0, 20.0])


test_a_stiffness_is_suggested_in_exactly_one_of_two_ways = refusals(
    ({}, "contact_stiffness: give either modulus, area and length, or storeys"),
    ({"storeys": (1.0, 2.0), "area": 1.0}, "give either"),
    ({"modulus": 1.0, "area": 1.0}, "contact_stiffness: length = None must be a real number"),
    ({"modulus": 1.0, "area": 0, "length": 1.0}, "area = 0 must be positive and finite"),
    ({"storeys": (1.0, -2.0)}, r"storeys\.1 = -2 must be positive and finite"),
    ({"storeys": (1.0,)}, r"storeys = \(1\.0,\) must be two numbers or more"),
    ({"storeys": 5.0}, r"storeys = 5\.0 must be two numbers or more"),
    of=lambda given: jp.contact_stiffness(**given),
)
