"""Response spectra: a value of one as a measure of a study, and those of bilinear oscillators."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound import _checks
from jaxpound._checks import Rule, all_hold, enforce, instance, number, positive, positive_number
from jaxpound._errors import InvalidInput
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import damping_rule, spectral_acceleration
from jaxpound.ground.measure import Measure
from jaxpound.ground.motion import GroundLike, require_seconds
from jaxpound.ground.record import Record
from jaxpound.ground.run_input import as_run
from jaxpound.model.building import PERIOD, Building
from jaxpound.model.hysteresis import Bilinear
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.quantities import STANDARD_GRAVITY, unit
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.time_steps import record_grid

_TRIED, _LEVELS = 40, 3  # strengths between two, and how often the search narrows them


@dataclasses.dataclass(frozen=True)
class SpectralAcceleration:
    """Pseudo-spectral acceleration at a period, with 5 % of damping: one of ``measures``.

    Of ``Buildings`` it is in m/s², else in g; ``period`` is in the unit of time of the run.

    Examples
    --------
    >>> grid, steel = jp.TimeGrid.until(8.0, dt=0.1), jp.paper.structures()
    >>> wavelets = jp.RandomRicker(1, jp.Uniform(0.01, 0.1), jp.Uniform(2, 3), jp.Uniform(2, 4))
    >>> at_2 = jp.study.SpectralAcceleration.of(steel, period=2.0, grid=grid)
    >>> scenarios, kept = jp.Scenarios(steel, wavelets), jp.Storage(measures={"sa": at_2})
    >>> study = jp.monte_carlo(scenarios, 16, grid, store=kept, progress=False)
    >>> str(study.measure("sa")), bool((study["sa"] > 0).all())
    ('Sa(2 1/ω1) (g)', True)
    """

    measure: str
    """The measure of intensity with its unit, by which curves and hazards know it."""
    period: float
    grid: TimeGrid

    @classmethod
    def of(cls, structures: Any, period: float, grid: TimeGrid) -> SpectralAcceleration:
        """That of a study of these structures, whose runs have this grid.

        Raises ``ValueError`` for a period that is not positive, and for another grid or structures.
        """
        instance("structures", structures, Structures)
        (period,) = positive_number(period=period)
        instance("grid", grid, TimeGrid)
        of_time, of_acceleration = (unit(x, in_si(structures)) for x in ("time", "acceleration"))
        measure = Measure.spectral_acceleration(period, of_time, of_acceleration)
        return cls(str(measure), period, grid)

    def __call__(self, structures: Any, ground: GroundLike) -> jax.Array:
        """The value in a scenario."""
        motion = as_run(ground, self.grid, gravity_of(structures))
        return spectral_acceleration(motion, self.grid, period=self.period)


class InelasticSpectrum(NamedTuple):
    """Bilinear oscillators under a record, arrays of one shape."""

    period: jax.Array  # of small vibrations, s
    strength: jax.Array  # yield force over weight
    ductility: jax.Array  # peak displacement over yield displacement
    displacement: jax.Array  # peak relative to the ground, m


def inelastic_spectrum(
    record: Record,
    periods: Any,
    *,
    strength: Any = None,
    ductility: Any = None,
    damping: Any = 0.05,
    hardening: Any = 0.0,
    dt: float | None = None,
) -> InelasticSpectrum:
    """Ductility of bilinear oscillators of a strength, or the strength for a ductility.

    An oscillator has a mass m, a viscous damper of ratio ζ and a ``Bilinear`` spring, whose yield
    displacement is f_y/(m ω²); it starts from rest, and its motion after the last sample does not
    count. All oscillators are one batch of ``demand``.

    The ductility need not grow where the strength falls, so that several strengths may have it: the
    result is the largest that reaches it (Chopra 2012, section 7.5). The search tries 40 strengths,
    then 40 between the largest that reaches the ductility and the next, and so on; a peak of the
    ductility between two of them may be overlooked. It is NaN where no strength down to the elastic
    one over ten times the ductility reaches it.

    Works under ``jit``, ``vmap``, ``grad`` and ``jacfwd`` over strength, ductility, hardening and
    samples; traced numbers that break a rule give NaN. Raises ``ValueError`` if a number, a shape
    or the record breaks its rule, or periods, damping or the record's interval are traced.

    Parameters
    ----------
    record
        Ground acceleration, in g and s.
    periods
        Natural periods of small vibrations, from 0.002 to 60 s, of any shape.
    strength, ductility
        One of the two: the yield force over the weight > 0, or the ductility ≥ 1. Their shapes
        broadcast with that of ``periods``.
    damping, hardening
        One number each: ζ from 0 to below 1; the stiffness after yield over that before, 0 to 1.
    dt
        Time step in s; by default the record's sample interval or a whole part of it, with at least
        50 steps in the shortest period and within half of the stability limit.

    Examples
    --------
    >>> t = 0.02 * np.arange(500)
    >>> record = jp.Record(0.3 * np.sin(7 * t) * np.exp(-((t - 4) ** 2)), dt=0.02)
    >>> weak = jp.inelastic_spectrum(record, [0.5, 1.0], strength=0.2)
    >>> print(*(f"{x:.1f}" for x in weak.ductility))
    6.7 2.4
    """
    instance("record", record, Record)
    require_seconds("record", record)
    if (strength is None) == (ductility is None):
        raise InvalidInput("strength and ductility", "", "must be one of them, not both")
    if _checks.is_traced((periods, damping, record.dt)):
        rule = "must be known, not traced: the time step follows"
        raise InvalidInput("periods, damping and record.dt", "", rule)
    stated = {"strength": strength} if ductility is None else {"ductility": ductility}
    period, level = positive(periods=periods, **stated)
    zeta, alpha = number("damping", damping), number("hardening", hardening)
    if not np.size(period):
        raise InvalidInput("periods", "", "must not be empty")
    _checks.require_batch(periods=period, **dict.fromkeys(stated, level))
    checks = [
        PERIOD.of("periods", period),
        damping_rule(zeta),
        Rule("hardening", alpha, (alpha >= 0) & (alpha <= 1), "from 0 to 1"),
        Rule("ductility", level, (level >= 1) | (strength is not None), "at least 1"),
    ]
    enforce(checks)
    shortest = Buildings.of((_oscillator(np.min(period), zeta),))
    grid = record_grid(shortest, Scheme(), [record], dt=dt)
    spectrum = _spectrum(record, jnp.asarray(period), level, zeta, alpha, grid, strength is None)
    return jax.tree.map(lambda y: jnp.where(all_hold(checks), y, jnp.nan), spectrum)


def _oscillator(period: Any, damping: Any) -> Building:
    return Building.from_period(1.0, period, damping, order=None)


@partial(jax.jit, static_argnames=("grid", "solves"))
def _spectrum(
    record: Record, periods: Any, level: Any, zeta: Any, alpha: Any, grid: TimeGrid, solves: bool
) -> InelasticSpectrum:
    def ductility(record: Record, alpha: Any, period: Any, strength: Any) -> Any:
        block = _oscillator(period, zeta)
        law = Bilinear(strength * STANDARD_GRAVITY / block.stiffness, alpha)
        weak = Buildings((dataclasses.replace(block, hysteresis=law),))
        return demand(weak, record, grid, only=["ductility_1"]).ductility_1

    def required(period: Any, target: Any) -> Any:
        fixed = jax.lax.stop_gradient((record, alpha))  # the search itself has no derivative

        def narrowed(ends: Any, _: Any) -> Any:
            tried = jnp.geomspace(ends[0], ends[1], _TRIED)  # which rounds its ends
            tried = tried.at[0].set(ends[0]).at[-1].set(ends[1])
            reach = jax.vmap(partial(ductility, *fixed, period))(tried) >= target
            last = jnp.max(jnp.where(reach[:-1], jnp.arange(_TRIED - 1), 0))
            return (tried[last], tried[last + 1]), reach.any()

        elastic = spectral_acceleration(record, period=period, damping=zeta)
        ends = jax.lax.stop_gradient((elastic / (10 * target), 1.1 * elastic))
        (low, high), reached = jax.lax.scan(narrowed, ends, length=_LEVELS)
        most, least = jax.vmap(partial(ductility, record, alpha, period))(jnp.stack([low, high]))
        falls = most > least
        share = jnp.where(falls, (most - target) / jnp.where(falls, most - least, 1.0), 0.0)
        return jnp.where(reached[0], low + (high - low) * share, jnp.nan)

    periods, level = jnp.broadcast_arrays(periods, level)
    if solves:
        strength, reached = jnp.vectorize(required)(periods, level), level
    else:
        strength, reached = level, jnp.vectorize(partial(ductility, record, alpha))(periods, level)
    displacement = reached * strength * STANDARD_GRAVITY / (2 * jnp.pi / periods) ** 2
    return InelasticSpectrum(periods, strength, reached, displacement)
