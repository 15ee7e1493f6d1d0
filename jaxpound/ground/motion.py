"""Ground motions: their interface, their sums and scalings, values on a time grid.

In the dimensionless model (eq. 9) acceleration is in units of g and time in units of 1/ω1. A record
as read from a file is in g and seconds (its ``time_unit``), and dimensionless runs refuse it until
``Scales.to_dimensionless`` has converted it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, finite, instead, is_traced, number, real
from jaxpound._fields import check, parameter, part, pytree_dataclass
from jaxpound.grid import TimeGrid

SECONDS, DIMENSIONLESS = "s", "1/ω1"
"""Units of time that a record may be in."""

_TIME_UNITS = {SECONDS: SECONDS, DIMENSIONLESS: DIMENSIONLESS, "1/omega1": DIMENSIONLESS}


def known_unit(owner: str, value: Any) -> str:
    """A unit of time, "s" or "1/ω1" (also spelled "1/omega1"); a ``ValueError`` for others."""
    if not (isinstance(value, str) and value in _TIME_UNITS):
        rule = f"{SECONDS!r} or {DIMENSIONLESS!r}"
        raise ValueError(f"{owner}: time_unit = {value!r} must be {rule}")
    return _TIME_UNITS[value]


@runtime_checkable
class Ground(Protocol):
    """What the simulator needs of a ground motion: its acceleration.

    Optional methods:

    - ``velocity(t)``: u'(t), of the shape of ``t``, the exact integral of the acceleration. The
      time loop then takes the exact mean of u'' over each step (the difference of u' at its ends),
      so that value and gradient are second-order accurate however the acceleration jumps between
      the instants of the grid; without it, the value of u'' in the middle of the step, which is as
      accurate where u'' is smooth. The velocity of the ground in a ``Response`` is exact, too.
    - ``unresolved(dt)``: sentences that say which part of the motion steps of dt do not resolve.

    The time loop calls both where the object is a pytree of arrays, as in the example. Any other
    object, and a plain function, is evaluated at the instants of the grid before the run, which
    uses these values alone. Subclasses of ``GroundMotion`` can be added and scaled, and may
    override each of its methods.

    Examples
    --------
    A rectangular pulse, whose ends need not be instants of the grid, and the derivative of the
    smallest gap by the instant at which it ends:

    >>> import dataclasses, jax, jax.numpy as jnp
    >>> @jax.tree_util.register_dataclass
    ... @dataclasses.dataclass(frozen=True)
    ... class Pulse:
    ...     size: float
    ...     start: float
    ...     end: float
    ...
    ...     def acceleration(self, t):
    ...         return jnp.where((t >= self.start) & (t < self.end), self.size, 0.0)
    ...
    ...     def velocity(self, t):
    ...         return self.size * (jnp.clip(t, self.start, self.end) - self.start)
    >>> grid = jp.TimeGrid.until(10.0, dt=0.02)
    >>> def min_gap(pulse):
    ...     return jp.demand(jp.paper.structures(), pulse, grid).min_gap
    >>> pulse = Pulse(size=-0.5, start=1.0, end=2.003)
    >>> round(float(min_gap(pulse)), 3), round(float(jax.grad(min_gap)(pulse).end), 2)
    (0.923, -0.11)
    """

    def acceleration(self, t: ArrayLike) -> Any:
        """Ground acceleration u''(t), of the shape of ``t``."""


GroundLike = Ground | Callable[[Any], Any]


class Excitation(NamedTuple):
    """A ground motion as the time loop takes it.

    ``series`` is a pytree of arrays with one entry for each instant of the grid along their first
    axis, which the loop reads as it runs: so the derivative by a whole record costs no more than
    the loop itself. ``at(t, entry)``, with the entries of the instant t, is u''(t) and the mean of
    u'' over the step from t − h/2 to t + h/2.
    """

    series: Any
    at: Callable[[Any, Any], tuple[Any, Any]]


class GroundMotion:
    """Base class: all methods of a ground motion from its ``acceleration``; sums and scalings.

    Ground motions are combined by ``a + b``, ``a - b``, ``2 * a``, ``a / 2``, ``-a`` and
    ``sum([a, b])``. One of the two that are added or subtracted may be a plain function of t.
    """

    __array_ufunc__ = None  # so that a NumPy factor on the left calls our ``__rmul__``
    velocity: Callable[[Any], Any] | None = None  # u'(t), of the shape of t, where it is known
    time_unit: str | None = None  # where u'' is in g, as a record's is: its unit of time

    def acceleration(self, t: ArrayLike) -> Any:
        """u''(t), of the shape of ``t``."""
        raise NotImplementedError

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """The ground motion as the time loop of a scheme of order 1 or 2 takes it.

        The mean over a step is u''(t), or in a scheme of order 2 the exact one if there is a
        ``velocity``.
        """
        u, v, h = self.acceleration, self.velocity, grid.dt
        if v is None or order == 1:
            return Excitation((), lambda t, _: (u(t),) * 2)
        return Excitation((), lambda t, _: (u(t), mean_acceleration(v, t, h)))

    def velocity_and_bulge(self, t: Array, h: float) -> tuple[Array, Array]:
        """Velocity u' at the instants t of a grid, and the mean of u'(t ∓ h/2) less u'(t).

        Shape (n,), of n instants that are h apart. Exact where there is a ``velocity``, else by the
        trapezoidal sum from rest.
        """
        if velocity := self.velocity:
            now, around = velocity(t), (velocity(t - h / 2) + velocity(t + h / 2)) / 2
            return now, around - now
        a = jax.vmap(self.acceleration)(t)
        rise = jnp.pad((a[2:] - a[:-2]) / 2, 1)
        return jnp.pad(jnp.cumsum((a[1:] + a[:-1]) * h / 2), (1, 0)), h / 8 * rise

    def samples_at(self, t: np.ndarray) -> Any:
        """Acceleration u'' at many instants, shape (n,), in whatever way it can be evaluated."""
        return _evaluated(self.acceleration, t)

    def parts(self) -> Iterator[GroundMotion]:
        """The ground motions that this one is a sum or scaling of."""
        yield self

    def unresolved(self, dt: float) -> list[str]:
        """Which part of it steps of ``dt`` do not resolve, in words, as far as it is known."""
        return []

    def energy(self, since: float) -> float | None:
        """About ∫ u''² dt from an instant on, at its known values; None where it is not known."""
        return None

    def dimensionless(self, frequency: Any) -> GroundMotion:
        """The motion, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s.

        Raises
        ------
        ValueError
            If a part of it is not in seconds, or has no unit of time.
        """
        raise ValueError(f"{self!r} must be in seconds, but has no unit of time")

    def __add__(self, other: GroundLike) -> Sum:
        if hasattr(other, "draw"):  # a random motion, whose own sum it is
            return NotImplemented
        return Sum((self, other))

    def __radd__(self, other: GroundLike | int) -> Any:
        if isinstance(other, int) and other == 0:  # where the builtin sum starts
            return self
        return Sum((other, self))

    def __sub__(self, other: GroundLike) -> Sum:
        if hasattr(other, "draw"):
            return NotImplemented
        return Sum((self, Scaled(other, -1.0)))

    def __rsub__(self, other: GroundLike) -> Sum:
        return Sum((other, Scaled(self, -1.0)))

    def __mul__(self, factor: ArrayLike) -> Scaled:
        return Scaled(self, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: ArrayLike) -> Scaled:
        return Scaled(self, 1 / number("Scaled", "divisor", divisor))

    def __neg__(self) -> Scaled:
        return Scaled(self, -1.0)


class _Own(GroundMotion):
    """A user's object or function; methods that it lacks are those of ``GroundMotion``."""

    def __init__(self, ground: GroundLike) -> None:
        own = {name: getattr(ground, name, None) for name in ("velocity", "unresolved")}
        acceleration = ground.acceleration if isinstance(ground, Ground) else ground
        methods = {"acceleration": acceleration} | own
        vars(self).update({name: method for name, method in methods.items() if callable(method)})


def as_motion(ground: GroundLike) -> GroundMotion:
    """A ground motion as a ``GroundMotion``, wrapped if it is none."""
    return ground if isinstance(ground, GroundMotion) else _Own(ground)


@pytree_dataclass
class Sum(GroundMotion):
    """The sum of several ground motions; a plain function of t counts as one."""

    grounds: tuple[Any, ...] = part()

    def __post_init__(self) -> None:
        object.__setattr__(self, "grounds", tuple(self.grounds))
        if not self.grounds:
            raise ValueError("Sum: grounds = () must hold at least one ground motion")
        for i, ground in enumerate(self.grounds):
            require_ground(f"Sum: grounds[{i}]", ground)
        records = list(records_in(self))
        for record in records:
            if record.time_unit != records[0].time_unit:
                rule = f"must be in the same unit of time as {records[0]!r}"
                raise ValueError(f"Sum: grounds: {record!r} {rule}")

    def acceleration(self, t: ArrayLike) -> Any:
        """Sum of the accelerations, of the shape of ``t``."""
        return sum(ground.acceleration(t) for ground in self._motions())

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """Series of the parts, and the sum of their accelerations."""
        series, each_at = zip(*(x.excitation(grid, order) for x in self._motions()), strict=True)

        def at(t: Any, entries: Any) -> tuple[Any, Any]:
            return _summed([at(t, entry) for at, entry in zip(each_at, entries, strict=True)])

        return Excitation(series, at)

    def velocity_and_bulge(self, t: Array, h: float) -> tuple[Array, Array]:
        """Sums over the parts."""
        return _summed([ground.velocity_and_bulge(t, h) for ground in self._motions()])

    def samples_at(self, t: np.ndarray) -> Any:
        """Sum over the parts."""
        return sum(ground.samples_at(t) for ground in self._motions())

    def parts(self) -> Iterator[GroundMotion]:
        """The parts of each ground motion of the sum."""
        for ground in self._motions():
            yield from ground.parts()

    def unresolved(self, dt: float) -> list[str]:
        """What steps of ``dt`` do not resolve in each part, in words."""
        return [said for ground in self._motions() for said in ground.unresolved(dt)]

    def energy(self, since: float) -> float | None:
        """Sum over the parts, as of independent ones."""
        energies = [ground.energy(since) for ground in self._motions()]
        known = [energy for energy in energies if energy is not None]
        return sum(known) if len(known) == len(energies) else None

    def dimensionless(self, frequency: Any) -> Sum:
        """The sum of the parts, each in units of 1/ω1."""
        return Sum(tuple(ground.dimensionless(frequency) for ground in self._motions()))

    def _motions(self) -> list[GroundMotion]:
        return [as_motion(ground) for ground in self.grounds]


@pytree_dataclass
class Scaled(GroundMotion):
    """A ground motion times a real factor."""

    ground: Any = part()
    factor: Any = parameter("", words="factor of the ground motion")

    def __post_init__(self) -> None:
        require_ground("Scaled: ground", self.ground)
        number("Scaled", "factor", self.factor)
        check(self)

    def acceleration(self, t: ArrayLike) -> Any:
        """Factor times the acceleration, of the shape of ``t``."""
        return self.factor * as_motion(self.ground).acceleration(t)

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """With the unscaled series, which many factors of one ground motion share."""
        series, whole = as_motion(self.ground).excitation(grid, order)
        return Excitation(series, lambda t, entry: self._times(whole(t, entry)))

    def velocity_and_bulge(self, t: Array, h: float) -> tuple[Array, Array]:
        """Factor times the ground motion's."""
        return self._times(as_motion(self.ground).velocity_and_bulge(t, h))

    def samples_at(self, t: np.ndarray) -> Any:
        """Factor times the ground motion's."""
        return self.factor * as_motion(self.ground).samples_at(t)

    def parts(self) -> Iterator[GroundMotion]:
        """The parts of the ground motion that is scaled."""
        return as_motion(self.ground).parts()

    def unresolved(self, dt: float) -> list[str]:
        """What steps of ``dt`` do not resolve of the ground motion, in words."""
        return as_motion(self.ground).unresolved(dt) if np.any(self.factor) else []

    def energy(self, since: float) -> float | None:
        """The factor's square times that of the ground motion."""
        energy, factor = as_motion(self.ground).energy(since), float(self.factor)
        return None if energy is None else factor * factor * energy  # a power raises overflow

    def dimensionless(self, frequency: Any) -> Scaled:
        """The factor times the ground motion in units of 1/ω1."""
        return Scaled(as_motion(self.ground).dimensionless(frequency), self.factor)

    def _times(self, pair: tuple[Any, Any]) -> tuple[Any, Any]:
        return self.factor * pair[0], self.factor * pair[1]


@pytree_dataclass
class Sampled(GroundMotion):
    """Values at the instants m·dt of a time grid, and nothing in between."""

    samples: Any = parameter(r"u''", "acceleration", "ground acceleration")
    dt: Any

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t) at an instant of the grid, of the shape of ``t``."""
        return jnp.asarray(self.samples)[jnp.round(jnp.asarray(t) / self.dt).astype(int)]

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """The samples."""
        return Excitation(self.acceleration(instants(grid, self)), lambda _, entry: (entry, entry))


def mean_acceleration(velocity: Callable[[Any], Any], t: Any, h: float) -> Any:
    """Mean of u'' from t − h/2 to t + h/2, from the velocity u'."""
    return (velocity(t + h / 2) - velocity(t - h / 2)) / h


def instants(grid: TimeGrid, tree: Any) -> Float[Array, " n_steps+1"]:
    """The instants of a grid as the time loop has them, in the precision of a tree's arrays."""
    dtype = jnp.result_type(float, *jax.tree.leaves(tree))
    # Rounded here: compiled, m·dt might be fused with later operations and be rounded otherwise.
    return jnp.asarray(np.arange(grid.n_steps + 1, dtype=dtype) * np.asarray(grid.dt, dtype))


def _summed(pairs: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    first, second = zip(*pairs, strict=True)
    return sum(first), sum(second)


def excitation(ground: GroundLike, grid: TimeGrid, order: int) -> Excitation:
    """A ground motion as the time loop of a scheme of order 1 or 2 takes it."""
    return as_motion(ground).excitation(grid, order)


def velocity_and_bulge(ground: GroundLike, t: Array, h: float) -> tuple[Array, Array]:
    """Velocity u' at the instants t, h apart, and the mean of u'(t ∓ h/2) less u'(t)."""
    return as_motion(ground).velocity_and_bulge(t, h)


def sampled(ground: GroundLike, grid: TimeGrid) -> Sampled:
    """The ground motion at the instants of a time grid.

    This is how the simulator takes a ground motion that is not a pytree of arrays (a Python
    function, say): it is evaluated once on the grid, for all instants at once or, if that raises
    ``TypeError`` or ``ValueError``, by ``jax.vmap`` or at last one by one, where its errors pass.

    Raises
    ------
    ValueError
        If it returns anything but a finite real number for each instant.
    """
    require_ground("ground", ground)
    t = grid.times()
    return Sampled(as_motion(ground).samples_at(t), grid.dt)


def records_in(ground: GroundLike) -> Iterator[GroundMotion]:
    """The parts of a ground motion that are records: in g, with a unit of time."""
    return (part for part in as_motion(ground).parts() if part.time_unit)


def require_seconds(place: str, record: Any) -> None:
    """A ``ValueError`` for a motion that is in units of 1/ω1 already."""
    if record.time_unit != SECONDS:
        unit = record.time_unit
        found = f"is in units of {unit} already" if unit else "has no unit of time"
        raise ValueError(f"{place} = {record!r} must be in seconds, but {found}")


def require_dimensionless(place: str, ground: GroundLike) -> None:
    """A ``ValueError`` for a record in seconds, also within sums and scalings."""
    for record in records_in(ground):
        if record.time_unit != DIMENSIONLESS:
            raise ValueError(
                f"{place}: {record!r} must be in units of {DIMENSIONLESS}, as the structures are: "
                "scales.to_dimensionless(record) makes it so, or simulate_buildings takes "
                "buildings and a record as they are, in SI units"
            )


def unresolved(ground: GroundLike, dt: float) -> list[str]:
    """Which part of a motion steps of dt do not resolve, in words, as far as it is known."""
    return [] if is_traced(ground) else as_motion(ground).unresolved(dt)


def as_pytree(ground: GroundLike, grid: TimeGrid) -> Ground:
    """The ground motion as a run takes it: itself if JAX can trace through it, else ``sampled``.

    Raises
    ------
    ValueError
        If it is made of a record in seconds, or as ``sampled``.
    """
    require_dimensionless("ground", ground)
    leaves = jax.tree.leaves(ground)
    if isinstance(ground, Ground) and all(hasattr(x, "dtype") or np.isscalar(x) for x in leaves):
        return ground
    return sampled(ground, grid)


def _evaluated(acceleration: Callable[[Any], Any], t: np.ndarray) -> Any:
    """Values at all instants at once, or else by ``jax.vmap``, or at last one by one."""
    values: Any = None
    for whole in (acceleration, jax.vmap(acceleration)):
        with suppress(TypeError, ValueError):
            values = whole(t)
            break
    else:
        values = [acceleration(float(instant)) for instant in t]
        if not is_traced(values):  # one by one: JAX would compile a program of as many inputs
            values = [np.asarray(value) for value in values]
    values = real("ground", "acceleration(t)", values)
    if jnp.shape(values) not in ((), t.shape):
        raise ValueError(
            f"ground: acceleration(t) of shape {jnp.shape(values)} must have the shape of t, "
            f"{t.shape}"
        )
    enforce("ground", [Rule("acceleration(t)", values, finite(values), "finite")])
    return jnp.broadcast_to(values, t.shape)


def require_ground(name: str, value: Any) -> None:
    """A ``ValueError`` for what is neither a ground motion nor a function of t."""
    if not (callable(value) or isinstance(value, Ground)):
        rule = f"have acceleration(t) or be a function of t{instead(value, 'Record')}"
        raise ValueError(f"{name} = {value!r} must {rule}")
