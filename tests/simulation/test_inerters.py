"""Inerters against exact vibrations, against heavier masses, and in groups of links that slip."""

import dataclasses
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

import jaxpound as jp
from tests.simulation.pairs import in_unit_of_time

G = jp.GROUND
ELASTIC = jp.ZenerRod(order=1.0, tau_f=1e-9, tau_x=1e-9)
STEEL = jp.ZenerRod(order=0.5, tau_f=0.02, tau_x=0.1)
MASSES, X, V = (1.0, 0.7, 0.02), np.array([1.0, -0.4, 0.3]), np.array([0.2, 0.5, -0.6])
RODS = {(0, G): 1.0, (1, G): 1.4, (2, 1): 0.8}
END = 6.0


def influence(ends):
    column = np.zeros(4)
    column[[*ends]] += 1.0, -1.0
    return column[:3]  # without the ground


def matrices(inertances):
    mass, stiffness = np.diag(MASSES), np.zeros((3, 3))
    for matrix, elements in ((mass, inertances), (stiffness, RODS)):
        for ends, number in elements.items():
            matrix += number * np.outer(influence(ends), influence(ends))
    return mass, stiffness


def vibration(inertances, t):
    """Displacements (3, n) of free vibrations from X and V."""
    mass, stiffness = matrices(inertances)
    squares, shapes = eigh(stiffness, mass)
    omega, start, speed = np.sqrt(squares), shapes.T @ mass @ X, shapes.T @ mass @ V
    angle = np.outer(omega, t)
    return shapes @ (start[:, None] * np.cos(angle) + (speed / omega)[:, None] * np.sin(angle))


def three(material, masses, links):
    rods = [jp.Rod(material, stiffness, ends) for ends, stiffness in RODS.items()]
    return jp.System(masses, rods, links)


def elastic(inertances):
    links = [jp.Link(ends, inerter=jp.Inerter(b)) for ends, b in inertances.items()]
    return three(ELASTIC, MASSES, links)


WAVE, GRID = jp.Ricker(0.5, [2.0], [1.5]), jp.TimeGrid.until(12.0, dt=0.04)
ALONE, SHARED = {(0, 2): 0.6}, {(2, G): 0.3, (0, 2): 0.6}
FREE = jp.TimeGrid(END / 120, 240)


@cache
def free_vibration(is_shared):
    """A program, at any step, for runs and derivatives by the inertance of masses 0 and 2."""
    inertances = SHARED if is_shared else ALONE

    def positions(b, unit):
        system, start = elastic(inertances | {(0, 2): b}), jp.InitialState(X, V)
        system, start = in_unit_of_time(unit, system, start)
        run = jp.simulate(system, dataclasses.replace(WAVE, amplitude=0.0), FREE, initial=start)
        return jnp.stack([mass.x for mass in run.masses])

    return jax.jit(lambda b, unit: jax.jvp(partial(positions, unit=unit), (b,), (1.0,)))


@pytest.mark.parametrize("inertances", [ALONE, SHARED], ids=["alone", "of one mass"])
def test_free_vibrations_and_their_derivatives_by_an_inertance_are_of_second_order(inertances):
    """The third mass is light: its motion is that of the inerters."""
    errors, small, run = [], 1e-5, free_vibration(inertances is SHARED)
    for n in (120, 240):
        values, t = [x[:, : n + 1] for x in run(0.6, 120 / n)], np.linspace(0, END, n + 1)
        changed = (inertances | {(0, 2): 0.6 + change} for change in (-small, 0, small))
        low, exact, high = (vibration(each, t) for each in changed)
        pairs = zip(values, (exact, (high - low) / (2 * small)), strict=True)
        errors.append([np.linalg.norm(x - y) / np.linalg.norm(y) for x, y in pairs])
    coarse, fine = np.array(errors)
    assert (fine < [1.5e-3, 6e-3]).all()
    assert (np.log2(coarse / fine) > 1.9).all()


def test_modes_and_the_stability_limit_are_those_of_the_mass_matrix_with_inertances():
    mass, stiffness = matrices(SHARED)
    omega = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
    modes = jp.modes(elastic(SHARED))
    assert modes.frequencies == pytest.approx(omega, rel=1e-8)
    assert modes.eigenvalues.imag == pytest.approx(omega, rel=1e-8)
    limit = jp.stability_limit(elastic(SHARED))
    assert limit == pytest.approx(2 / omega[-1], rel=1e-7)
    below, above = (free_vibration(True)(0.6, x * limit / FREE.dt)[0] for x in (0.999, 1.001))
    assert np.isfinite(below).all()
    assert np.isnan(above).all()


SHARE = 0.4  # of the whole mass that is a mass, not an inertance


def pounding(numbers, share):
    """A mass that slides between two walls: a share of it is mass, the rest inertance."""
    friction, gap, stiffness = numbers
    contact, inerter = jp.KelvinVoigt(stiffness, 0.6), jp.Inerter(1 - share)
    link = jp.Link((0, G), friction, (gap, 1.5 * gap), contact, inerter=inerter)
    system = jp.System((share,), (jp.Rod(STEEL, 1.0, (0, G)),), (link,))
    ground = dataclasses.replace(WAVE, amplitude=0.5 / share)
    start = jp.InitialState((0.02,), (0.1,))
    run = jp.simulate(system, ground, GRID, initial=start)
    names = ("x1", "v1", "gap_2", "friction_1", "contact_1", "contact_2")
    return {name: getattr(run, name) for name in names}, run


def test_an_inerter_to_the_ground_is_a_mass_that_the_ground_does_not_load():
    """In contact, slip and stick, in values and derivatives."""
    numbers = jnp.array([0.04, 0.15, 30.0])

    @jax.jit
    def along(share):
        of_share = partial(pounding, share=share)
        return jax.jvp(of_share, (numbers,), (numbers,), has_aux=True)

    (*whole, run), (*part, other) = along(1.0), along(SHARE)
    for series, others in zip(whole, part, strict=True):
        for name, y in series.items():
            within = {"rtol": 0, "atol": 1e-8 * np.abs(y).max()}
            np.testing.assert_allclose(others[name], y, **within, err_msg=name)
    assert other.demand.n_impacts_1 > 1
    assert other.demand.n_impacts_2 > 1
    assert np.isclose(other.demand.peak_impulse_1, run.demand.peak_impulse_1, rtol=1e-9)
    relative, same = (y.absolute_accelerations[0] - y.ground_acceleration for y in (run, other))
    # The whole shaken as the part: its ground has the whole amplitude.
    size = np.abs(relative).max()
    np.testing.assert_allclose(same, relative, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(other.inertia_1, (1 - SHARE) * relative, rtol=0, atol=1e-8 * size)
    largest = np.abs(other.absolute_accelerations[0]).max()
    assert 0.999 * largest <= other.demand.peak_acceleration_1 < 1.3 * largest
    assert other.energy.relative_residual < 5e-3


def test_inerters_in_a_group_that_slips_and_pounds():
    """Newton's equations hold in all steps without events, and the energy balance."""
    touching = jp.Link((0, 1), 0.03, 0.08, jp.Hertz(20.0), inerter=jp.Inerter(0.3))
    links = touching, jp.Link((2, 0), 0.02, inerter=jp.Inerter(0.5))
    system = three(STEEL, (1.0, 0.7, 0.4), links)
    residuals, dt, grid = [], 0.02, jp.TimeGrid(0.04, 600)
    program = jax.jit(lambda unit: jp.simulate(*in_unit_of_time(unit, system, WAVE), grid))
    for unit in (1.0, dt / grid.dt):  # by one program
        run = jp.Scales(1.0, 1 / unit, unit**-2.0).to_si(program(unit))
        residuals.append(run.energy.relative_residual)
    assert run.demand.n_impacts_1 > 1
    kinds = {phase.kind for k in (0, 1) for phase in run.phases(k)}
    assert {"stick", "slip left", "slip right"} <= kinds
    assert residuals[1] < 2e-3
    assert residuals[0] > 2 * residuals[1]
    x = np.stack([mass.x for mass in run.masses])
    second = np.diff(x, 2) / dt**2
    relative = np.stack(run.absolute_accelerations) - np.asarray(run.ground_acceleration)
    calm = np.ones(x.shape[1], bool)
    for link in run.links:
        changes = np.diff(link.phase, append=link.phase[-1]) != 0
        events = changes if link.touching is None else changes | (np.asarray(link.touching) != 0)
        near = np.flatnonzero(events)[:, None] + np.arange(-2, 3)
        calm[near.clip(0, calm.size - 1)] = False
    calm = calm[1:-1]
    assert calm.sum() > 200
    error = np.abs(second - relative[:, 1:-1])[:, calm].max()
    assert error < 2e-3 * np.abs(relative).max()
    inertia = [0.3 * (second[0] - second[1]), 0.5 * (second[2] - second[0])]
    for link, force in zip(run.links, inertia, strict=True):
        assert np.abs(link.inertia[1:-1] - force)[calm].max() < 2e-3 * np.abs(relative).max()
    # Accelerations jump with the friction of all links, also of those that do not touch the mass.
    for mass, series in zip(run.demand.masses, run.absolute_accelerations, strict=True):
        largest = np.abs(series).max()
        assert 0.999 * largest <= mass.peak_acceleration < 1.1 * largest


def test_peaks_of_accelerations_jump_with_the_friction():
    """As the step vanishes, peaks are the largest of the instants, also where slip turns."""
    link = jp.Link((0, 1), 0.1, inerter=jp.Inerter(0.8))
    system = three(ELASTIC, (1.0, 0.7, 0.4), (link,))
    grid = jp.TimeGrid(0.02, 12_000)

    @jax.jit
    def accelerations(unit):
        """Of a step that is ``unit`` times the grid's: the series, and their peaks."""
        run = jp.simulate(*in_unit_of_time(unit, system, WAVE), grid)
        peaks = [mass.peak_acceleration for mass in run.demand.masses]
        return jnp.stack(run.absolute_accelerations), peaks

    (_, peaks), (fine, _) = accelerations(1.0), accelerations(0.05)
    for peak, series in zip(peaks, fine / 0.05**2, strict=True):
        assert peak == pytest.approx(np.abs(series).max(), rel=2e-3)
