"""Rods that yield, against an event-driven solver, closed forms, and themselves."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import parameters
from tests.reference import load
from tests.simulation.pairs import in_unit_of_time

CASES = load("yield")
FIELDS = {"K": "stiffness", "ey": "material.yield_displacement", "alpha": "material.hardening"}
FIELDS |= {"beta": "material.beta", "gap0": "gap", "k": "contact.stiffness"}


def material_of(rod):
    if rod["law"] == "zener":
        return jp.ZenerRod(1.0, rod["tf"], rod["tx"])
    if rod["law"] == "bilinear":
        return jp.Bilinear(rod["ey"], rod["alpha"])
    return jp.BoucWen(rod["ey"], rod["alpha"], rod["n"], rod["beta"])


def system_of(case):
    system = case["system"]
    rods = (jp.Rod(material_of(x), x["K"], (x["b"], x["a"])) for x in system["rods"])
    links = [
        jp.Link((x["a"], x["b"]), 0.0, x["gap0"], jp.KelvinVoigt(x["k"], x["e"]))
        for x in system["links"]
    ]
    return jp.System(tuple(system["m"]), tuple(rods), links)


def ground_of(case):
    return jp.Ricker(case["ricker"]["u0"], case["ricker"]["tp"], case["ricker"]["ts"])


STEPS = (0.02, 0.005)
"""Runs of both are by one program, in units of time in which each is the grid's own step."""
ONE, ONE_GROUND = system_of(CASES["one_bilinear"]), ground_of(CASES["one_bilinear"])
GRID = jp.TimeGrid.until(16.0, 0.02)
ONE_RESPONSE = jax.jit(lambda system, ground: jp.simulate(system, ground, GRID))


def yielding_rods(case):
    return [r for r, rod in enumerate(case["system"]["rods"]) if rod["law"] != "zener"]


def errors(case, steps):
    """Of displacements and of gradients at each step, and the response at the last step.

    Displacements are relative to the largest of them. Of gradients it is the largest of all
    parameters, of each in the norm over final positions and velocities and largest elongations.
    The response is in units of time in which its step is the first of ``steps``.
    """
    system, ground, yielding = system_of(case), ground_of(case), yielding_rods(case)
    names = [x.replace("m.", "masses.").split(".") for x in case["derivatives"]]
    paths = [".".join(FIELDS.get(part, part) for part in name) for name in names]
    grid = jp.TimeGrid(steps[0], round(case["T"] / steps[-1]))
    numbers = np.array([parameters.get(system, path) for path in paths], float)

    @jax.jit
    def slopes_of(unit):
        """Derivatives of the results by the numbers, and the response."""

        def run(numbers):
            changed = parameters.put(system, dict(zip(paths, [*numbers], strict=True)))
            response = jp.simulate(*in_unit_of_time(unit, changed, ground), grid)
            end = jnp.round(case["T"] / (grid.dt * unit)).astype(int)
            results = [mass.x[end] for mass in response.masses]
            results += [mass.v[end] / unit for mass in response.masses]
            for r in yielding:
                at_yield = changed.rods[r].material.yield_displacement
                results.append(response.demand.rods[r].ductility * at_yield)
            return jnp.stack(results), response

        return jax.jacfwd(run, has_aux=True)(numbers)

    n = 2 * len(case["x_end"])
    results = [*range(n), *(n + r for r in yielding)]
    exact = np.array([*case["derivatives"].values()])[:, results]
    values, slopes = [], []
    for dt in steps:
        gradients, response = slopes_of(dt / grid.dt)
        x = np.stack([mass.x for mass in response.masses], -1)[:: round(1 / dt)][: len(case["x"])]
        values.append(np.abs(x - np.array(case["x"])).max() / np.abs(case["x"]).max())
        off = np.linalg.norm(gradients.T - exact, axis=1) / np.linalg.norm(exact, axis=1)
        slopes.append(off.max())
    return np.array(values), np.array(slopes), response


@pytest.mark.parametrize("name", [name for name in CASES if name[0] != "_"])
def test_values_and_gradients_are_of_second_order(name):
    case, ratio = CASES[name], STEPS[0] / STEPS[-1]
    values, slopes, response = errors(case, STEPS)
    assert values[-1] < 1e-4
    assert slopes[-1] < (2e-3 if name == "pounding_bilinear" else 1e-3)
    assert values[0] / values[-1] > 3.0 ** np.log2(ratio)
    assert slopes[0] / slopes[-1] > 2.5 ** np.log2(ratio)
    assert response.energy.relative_residual < 1e-3
    assert float(response.demand.collapsed) == 0
    for r in yielding_rods(case):
        scalars, hardening = response.demand.rods[r], case["system"]["rods"][r]["alpha"]
        assert scalars.ductility == pytest.approx(case["ductility"][r], rel=2e-4)
        if case["residual"][r]:
            residual = abs(case["residual"][r]) * (1 - hardening)
            assert scalars.residual_drift == pytest.approx(residual, rel=5e-3, abs=1e-5)
    total = sum(response.demand.rods[r].dissipated_energy for r in yielding_rods(case))
    assert total * ratio**2 == pytest.approx(case["dissipated"], rel=2e-4)
    assert response.energy.yielding[-1] == pytest.approx(float(total), rel=1e-12)


def test_before_it_yields_a_rod_is_the_fractional_rod_to_rounding():
    """Bit for bit unless XLA rounds products together with sums, as JAX 0.12 does (2.6e-16)."""
    steel = jp.ZenerRod(0.5, 0.01, 0.05)
    strong = jp.model.YieldingZener(steel, jp.Bilinear(1e6, 0.1))
    grid = jp.TimeGrid.until(8.0, 0.05)
    buildings = [jp.Storeys((1.0, 0.8), jp.Rod(law, 4.0)) for law in (steel, strong)]
    plain, yielding = (jp.simulate(building, ONE_GROUND, grid) for building in buildings)
    for name in ("x1", "x2", "v1", "f1", "f2"):
        series = getattr(yielding, name), getattr(plain, name)
        np.testing.assert_allclose(*series, rtol=0, atol=1e-15)
    assert plain.demand.collapsed is None
    assert float(yielding.demand.dissipated_energy_1) == 0
    assert float(yielding.demand.first_yield_time_2) == np.inf
    assert jp.floor_demands(buildings[0], plain.demand)[0].ductility is None
    (floors,) = jp.floor_demands(buildings[1], yielding.demand)
    parts = yielding.demand.rods, yielding.demand.rods, yielding.demand.masses
    names = "ductility", "dissipated_energy", "peak_acceleration"
    for name, elements in zip(names, parts, strict=True):
        largest = max(float(getattr(x, name)) for x in elements)
        assert float(getattr(yielding.demand, name)) == largest
    drifts = yielding.demand.peak_x1, yielding.demand.peak_drift_2
    assert float(yielding.demand.peak_drift) == float(plain.demand.peak_drift) == max(drifts)
    with pytest.raises(AttributeError, match="Demand has no 'ductility', the largest of all: no"):
        _ = plain.demand.ductility
    with pytest.raises(AttributeError, match=r"no attribute 'peak_x'; did you mean 'peak_x2'"):
        _ = plain.demand.peak_x
    np.testing.assert_array_equal(floors.ductility, [x.ductility for x in yielding.demand.rods])


def test_the_motion_has_a_mirror_image_and_a_batch_is_its_runs():
    plain = ONE_RESPONSE(ONE, ONE_GROUND)
    mirrored = ONE_RESPONSE(ONE, replace(ONE_GROUND, amplitude=-ONE_GROUND.amplitude))
    assert (plain.x1 == -mirrored.x1).all()
    assert plain.demand.ductility_1 == mirrored.demand.ductility_1

    def ductility(strength):
        only = ("ductility_1",)
        return jp.demand(weakened(strength), ONE_GROUND, GRID, only=only).rods[0].ductility

    strengths = np.array([0.02, 0.0315, 0.1])
    batch, backward = jax.jit(jax.vmap(jax.value_and_grad(ductility)))(strengths)
    assert batch[1] == pytest.approx(float(plain.demand.ductility_1), rel=1e-9)
    assert (np.diff(batch) < 0).all()
    forward = jax.jit(lambda x: jax.jvp(ductility, (x,), (1.0,))[1])(0.0315)
    assert backward[1] == pytest.approx(float(forward), rel=1e-8)
    low = ONE_RESPONSE(*jax.tree.map(np.float32, (ONE, ONE_GROUND)))
    assert low.x1.dtype == jnp.float32
    np.testing.assert_allclose(low.x1, plain.x1, atol=2e-5)


def weakened(strength):
    return parameters.put(ONE, {"rods.0.material.yield_displacement": strength})


def test_a_half_sine_yields_and_unloads_when_it_must():
    # m = 45,594 kg, k = 1.8 MN/m, 5 %, e_y = .02 m, 50 kN sin(πt/.6) until .6 s; exact solution.
    mass, stiffness = 45_594.0, 1.8e6
    damping = 2 * 0.05 * np.sqrt(stiffness * mass)
    laws = (jp.Bilinear(0.02), stiffness), (jp.ZenerRod(1.0, 1e-5, damping), 1.0)
    system = jp.System((mass,), tuple(jp.Rod(*law, (0, jp.GROUND)) for law in laws))

    def push(t):
        return -50e3 / mass * jnp.where(t < 0.6, jnp.sin(jnp.pi * t / 0.6), 0.0)

    response = jp.simulate(system, push, jp.TimeGrid.until(1.0, 0.001))
    assert response.demand.first_yield_time_1 == pytest.approx(0.314149, abs=2e-6)
    assert response.demand.peak_x1 == pytest.approx(0.0642469, abs=1e-6)
    assert response.x1[-1] == pytest.approx(0.03996081, abs=1e-6)
    assert response.demand.residual_drift_1 == pytest.approx(0.0642469 - 0.02, abs=1e-6)
    assert jnp.max(jnp.abs(response.f1)) <= 36e3 * (1 + 1e-12)


def test_no_force_exceeds_the_limit_of_an_elastoplastic_rod():
    """In two storeys, in a brace with a friction damper, and under a sudden force (Biggs 1964).

    Nor does the acceleration of the block that the last rod carries.
    """
    grid, steel = jp.TimeGrid.until(10.0, 0.04), jp.ZenerRod(0.5, 0.01, 0.05)

    @jax.jit
    @jax.vmap
    def of_limit(e_y, stiffness, amplitude):
        weak = jp.Rod(jp.Bilinear(e_y), stiffness)
        frame = replace(weak, material=steel, ends=(0, jp.GROUND))
        braced = jp.System((1.0,), (replace(weak, ends=(0, jp.GROUND)), frame))
        block = jp.Storeys((1.0,), weak)
        ricker = jp.Ricker(amplitude, (2.0,), (1.5,))
        runs = (jp.Storeys((1.0, 0.8), weak), ricker), (braced, ricker), (block, lambda t: t**0)
        demands = [jp.demand(*run, grid) for run in runs]
        peaks = [demand.rods[0].peak_force for demand in demands]
        return jnp.stack([*peaks, demands[2].masses[0].peak_acceleration]) / (stiffness * e_y)

    random = np.random.default_rng(0)
    peaks = of_limit(*random.uniform([[0.01], [5.0], [0.2]], [[0.1], [100.0], [1.0]], (3, 48)))
    assert peaks.max() < 1 + 1e-11  # rounding of elongations that are far beyond yield
    assert ((peaks > 1 - 1e-11).mean(0) > 0.3).all()


@jax.jit
@partial(jax.vmap, in_axes=(0, None))
def peaks_in(unit, system):
    """The largest force of the first rod and acceleration of its mass, in a unit of time."""
    grid = jp.TimeGrid.until(16 * 16.0, 0.04)
    demand = jp.demand(*in_unit_of_time(unit, system, ONE_GROUND), grid)
    return jnp.stack([demand.rods[0].peak_force, demand.masses[0].peak_acceleration])


@pytest.mark.parametrize("law", ["hardening", "softening", "beside a damper"])
def test_peak_forces_and_accelerations_are_of_second_order(law):
    """They are reached where the elongation turns, where the rod yields, or in between."""
    rod, e_y = ONE.rods[0], CASES["one_bilinear"]["system"]["rods"][0]["ey"]
    materials = {
        "hardening": rod.material,
        "softening": jp.Bilinear(e_y, -0.02, 1.0),
    }
    damped = jp.model.YieldingZener(jp.ZenerRod(1.0, 0.001, 0.01), materials["softening"])
    materials["beside a damper"] = damped
    system = replace(ONE, rods=(replace(rod, material=materials[law]), ONE.rods[1]))
    units = 1 / np.array([1.0, 2.0, 16.0])
    coarse, fine, exact = peaks_in(units, system) / units[:, None] ** 2
    assert (abs(coarse - exact) < 2e-3 * exact).all()
    assert (abs(fine - exact) < abs(coarse - exact) / 3).all()


def test_a_run_that_diverges_has_collapsed_and_is_finite():
    softening = replace(ONE.rods[0], material=jp.Bilinear(0.0315, -0.2, 0.3))
    system = replace(ONE, rods=(softening, ONE.rods[1]))
    strong, weak = (replace(ONE_GROUND, amplitude=x) for x in (0.3, 0.01))
    scalars = ONE_RESPONSE(system, strong).demand
    assert float(scalars.collapsed) == 1
    assert np.isfinite(scalars.peak_x1)
    assert scalars.peak_x1 > 0.3
    assert float(ONE_RESPONSE(system, weak).demand.collapsed) == 0


def test_released_from_beyond_yield_it_comes_to_rest_at_the_plastic_elongation():
    still, aside = replace(ONE_GROUND, amplitude=0.0), jp.InitialState((0.06,))
    response = jp.simulate(ONE, still, jp.TimeGrid.until(60.0, 0.02), initial=aside)
    spring = 4.927 * (0.06 - (1 - 0.027) * (0.06 - 0.0315))
    assert response.f1[0] == pytest.approx(spring, rel=1e-12)
    rest = response.demand.rods[0].residual_drift * 4.927 / (4.927 + 0.2463)
    assert response.x1[-1] == pytest.approx(float(rest), abs=1e-4)
    assert response.energy.relative_residual < 1e-3
