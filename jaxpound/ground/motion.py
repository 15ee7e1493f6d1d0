"""Ground motions: their interface, and their sums and scalings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from itertools import chain
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from jaxpound._checks import Rule, enforce, finite, instead, is_traced, number, real
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger
from jaxpound._fields import check, parameter, part, pytree_dataclass
from jaxpound.grid import TimeGrid

SECONDS, DIMENSIONLESS = "s", "1/ω1"  # units of time that a record may be in
_TIME_UNITS = {SECONDS: SECONDS, DIMENSIONLESS: DIMENSIONLESS, "1/omega1": DIMENSIONLESS}


def time_unit_of(value: Any) -> str:
    """A unit of time, "s" or "1/ω1" (also spelled "1/omega1"); an ``InvalidInput`` for others."""
    if not (isinstance(value, str) and value in _TIME_UNITS):
        raise InvalidInput("time_unit", repr(value), f"must be {SECONDS!r} or {DIMENSIONLESS!r}")
    return _TIME_UNITS[value]


@runtime_checkable
class Ground(Protocol):
    """The interface of a ground motion: its acceleration.

    Optional methods:

    - ``velocity(t)``: u'(t), of the shape of ``t``, the exact integral of the acceleration. The
      time loop then takes the exact mean of u'' over each step, so that value and gradient are
      second-order accurate even if the acceleration jumps between instants of the grid; without it,
      the value of u'' in the middle of the step, which is as accurate where u'' is smooth. The
      velocity of the ground in a ``Response`` is exact, too.
    - ``unresolved(dt)``: sentences on the parts of the motion that steps of dt do not resolve.

    An attribute ``duration``, the time after which it is over, lets others follow it in a
    ``sequence``.

    If the object is a pytree of arrays, as in the example, the time loop calls its methods; before
    the run ``unresolved`` is asked. Any other object, and a plain function, is evaluated at the
    instants of the grid before the run, which uses only these values. Subclasses of
    ``GroundMotion`` can be added and scaled, and may override each of its methods.

    Examples
    --------
    A rectangular pulse, whose ends need not be instants of the grid, and the derivative of the
    smallest gap by the end of the pulse:

    >>> import dataclasses, jax, jax.numpy as jnp
    >>> @jax.tree_util.register_dataclass
    ... @dataclasses.dataclass(frozen=True)
    ... class Pulse:
    ...     size: float
    ...     start: float
    ...     end: float
    ...     def acceleration(self, t):
    ...         return jnp.where((t >= self.start) & (t < self.end), self.size, 0.0)
    ...     def velocity(self, t):
    ...         return self.size * (jnp.clip(t, self.start, self.end) - self.start)
    >>> grid = jp.TimeGrid.until(10.0, dt=0.02)
    >>> def min_gap(pulse):
    ...     return jp.demand(jp.paper.structures(), pulse, grid).min_gap
    >>> pulse = Pulse(size=-0.5, start=1.0, end=2.003)
    >>> gap, slope = jax.jit(jax.value_and_grad(min_gap))(pulse)
    >>> round(float(gap), 3), round(float(slope.end), 2)
    (0.923, -0.11)
    """

    def acceleration(self, t: ArrayLike) -> Any:
        """Ground acceleration u''(t), of the shape of ``t``."""


GroundLike = Ground | Callable[[Any], Any] | tuple[Any, ...]
"""A ground motion: an object, a function of t, or a tuple with the motion of each support."""


class Excitation(NamedTuple):
    """A ground motion as the input of the time loop.

    ``series`` are arrays with an entry for each instant along their first axis. The loop reads one
    a step, so that the derivative by a whole record costs no more than the loop. ``at(t, entry)``
    is u''(t) and the mean of u'' over the step from t − h/2 to t + h/2; over its second half at
    t = 0, where a run begins, if u'' may jump there.
    """

    series: Any
    at: Callable[[Any, Any], tuple[Any, Any]]


SumT = TypeVar("SumT")
ScaledT = TypeVar("ScaledT")


class Addable(Generic[SumT, ScaledT]):
    """Sums and scalings: ``a + b``, ``a - b``, ``2 * a``, ``a / 2``, ``-a`` and ``sum([a, b])``.

    One of the two terms of a sum or difference may be a plain function of t.
    """

    __array_ufunc__ = None  # so that a NumPy factor on the left calls ``__rmul__``

    _make_sum: Callable[..., SumT]
    _make_scaled: Callable[..., ScaledT]

    def __add__(self, other: Any) -> SumT:
        return self._make_sum(self, other)

    def __radd__(self, other: Any) -> Any:
        if isinstance(other, int) and other == 0:  # where the builtin sum starts
            return self
        return self._make_sum(other, self)

    def __sub__(self, other: Any) -> SumT:
        minus = -other if isinstance(other, Addable) else self._make_scaled(other, -1.0)
        return self._make_sum(self, minus)

    def __rsub__(self, other: Any) -> SumT:
        return self._make_sum(other, -self)

    def __mul__(self, factor: Any) -> ScaledT:
        return self._make_scaled(self, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> ScaledT:
        divisor = number("divisor", divisor)
        enforce([Rule("divisor", divisor, divisor != 0, "no zero")])
        return self._make_scaled(self, 1 / divisor)

    def __neg__(self) -> ScaledT:
        return self._make_scaled(self, -1.0)


class GroundMotion(Addable["Sum", "Scaled"]):
    """Base class: all methods of a ground motion from its ``acceleration``; sums and scalings."""

    velocity: Callable[[Any], Any] | None = None  # u'(t), of the shape of t; None if unknown
    time_unit: str | None = None  # of a motion in g, such as a record

    def acceleration(self, t: ArrayLike) -> Any:
        """u''(t), of the shape of ``t``."""
        raise NotImplementedError

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """The input of the time loop of a scheme of order 1, whose mean is u''(t), or 2."""
        u, v, h = self.acceleration, self.velocity, grid.dt
        if v is None or order == 1:
            return Excitation((), lambda t, _: (u(t),) * 2)
        return Excitation((), lambda t, _: (u(t), mean_acceleration(v, t, h)))

    def velocity_and_bulge(self, t: Array, h: float) -> tuple[Array, Array]:
        """Velocity u' at the instants t of a grid, h apart, and the mean of u'(t ∓ h/2) less u'(t).

        Exact where there is a ``velocity``, else by the trapezoidal sum from rest.
        """
        if velocity := self.velocity:
            velocities, means = velocity(t), (velocity(t - h / 2) + velocity(t + h / 2)) / 2
            return velocities, means - velocities
        a = jax.vmap(self.acceleration)(t)
        rise = jnp.pad((a[2:] - a[:-2]) / 2, 1)
        return jnp.pad(jnp.cumsum((a[1:] + a[:-1]) * h / 2), (1, 0)), h / 8 * rise

    def samples_at(self, t: np.ndarray) -> Any:
        """Acceleration u'' at many instants, shape (n,): at once, by ``jax.vmap``, or one by one.

        A ``TypeError`` or ``ValueError`` leads to the next way; errors of the last propagate.
        """
        values: Any = None
        for evaluate in (self.acceleration, jax.vmap(self.acceleration)):
            with suppress(TypeError, ValueError):
                values = evaluate(t)
                break
        else:
            values = [self.acceleration(float(instant)) for instant in t]
            if not is_traced(values):  # JAX would compile a program of as many inputs
                values = [np.asarray(value) for value in values]
        values = real("ground: acceleration(t)", values)
        if jnp.shape(values) not in ((), t.shape):
            name = f"ground: acceleration(t) of shape {jnp.shape(values)}"
            raise InvalidInput(name, "", f"must have the shape of t, {t.shape}")
        enforce([Rule("ground: acceleration(t)", values, finite(values), "finite")])
        return jnp.broadcast_to(values, t.shape)

    def parts(self) -> Iterator[GroundMotion]:
        """The ground motions that a sum or scaling is made of."""
        yield self

    def unresolved(self, dt: float) -> list[str]:
        """Sentences on the parts that steps of ``dt`` do not resolve; empty if unknown."""
        return []

    def energy(self, since: float) -> float | None:
        """About ∫ u''² dt from an instant on, of concrete values; None if unknown."""
        return None

    def dimensionless(self, frequency: Any) -> GroundMotion:
        """The motion, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s.

        Raises ``ValueError`` if a part of it is not in seconds, or has no unit of time.
        """
        raise InvalidInput(repr(self), "", "must be in seconds, but has no unit of time")

    def in_si(self, gravity: Any) -> GroundMotion:
        """The motion in m/s²: records are in g, and motions without a unit of time in m/s²."""
        return Scaled(self, gravity) if self.time_unit else self

    def _later(self, delay: Any) -> GroundMotion:
        """The motion as a part of a sequence, in which its t = 0 is at ``delay``."""
        return _Late(self, delay)

    def _make_sum(self, *terms: Any) -> Sum:
        if any(hasattr(term, "draw") for term in terms):  # a random motion makes the sum
            return NotImplemented
        return Sum(terms)

    def _make_scaled(self, term: Any, factor: Any) -> Scaled:
        return Scaled(term, factor)


class _UserMotion(GroundMotion):
    """A user-defined object or function; methods that it lacks are those of ``GroundMotion``."""

    def __init__(self, ground: GroundLike) -> None:
        self._ground = ground
        methods = {name: getattr(ground, name, None) for name in ("velocity", "unresolved")}
        methods["acceleration"] = ground.acceleration if isinstance(ground, Ground) else ground
        vars(self).update({name: method for name, method in methods.items() if callable(method)})
        self.duration = getattr(ground, "duration", None)

    def in_si(self, gravity: Any) -> Any:
        return self._ground  # in m/s² already, and perhaps a pytree

    def _later(self, delay: Any) -> GroundMotion:
        return _Late(self._ground, delay)


def as_motion(ground: GroundLike) -> GroundMotion:
    """A ground motion as a ``GroundMotion``; a user-defined one is wrapped."""
    ground = by_supports(ground)
    return ground if isinstance(ground, GroundMotion) else _UserMotion(ground)


def by_supports(ground: GroundLike) -> Any:
    """The ground motion; ``SupportMotions`` in the place of a tuple."""
    return SupportMotions(ground) if isinstance(ground, tuple) else ground


class _Combination(GroundMotion):
    """A sum, scaling or sequence: its values are those of its terms, combined."""

    _terms: Callable[[], list[GroundMotion]]
    _combined: Callable[[Sequence[Any]], Any]
    _of_terms: Callable[[Callable[[GroundMotion], GroundMotion]], Any]

    def _pairs_combined(self, pairs: Iterable[tuple[Any, Any]]) -> tuple[Any, Any]:
        first, second = zip(*pairs, strict=True)
        return self._combined(first), self._combined(second)

    def acceleration(self, t: ArrayLike) -> Any:
        return self._combined([ground.acceleration(t) for ground in self._terms()])

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        # The series are those of the terms, which many scalings of one ground motion share.
        series, each_at = zip(*(x.excitation(grid, order) for x in self._terms()), strict=True)

        def at(t: Any, entries: Any) -> tuple[Any, Any]:
            return self._pairs_combined(at(t, x) for at, x in zip(each_at, entries, strict=True))

        return Excitation(series, at)

    def velocity_and_bulge(self, t: Array, h: float) -> tuple[Array, Array]:
        return self._pairs_combined(x.velocity_and_bulge(t, h) for x in self._terms())

    def samples_at(self, t: np.ndarray) -> Any:
        return self._combined([ground.samples_at(t) for ground in self._terms()])

    @property
    def duration(self) -> Any:
        """Time after which all is over; None if a part's is unknown."""
        ends: list[Any] = [getattr(ground, "duration", None) for ground in self._terms()]
        if any(end is None for end in ends):
            return None
        return reduce(larger, ends) if is_traced(ends) else max(ends)

    def parts(self) -> Iterator[GroundMotion]:
        return chain.from_iterable(ground.parts() for ground in self._terms())

    def unresolved(self, dt: float) -> list[str]:
        return [finding for ground in self._terms() for finding in ground.unresolved(dt)]

    def energy(self, since: float) -> float | None:
        """Sum over the parts, as if they were independent."""
        energies = [ground.energy(since) for ground in self._terms()]
        return None if None in energies else sum(energies)  # type: ignore[arg-type]

    def dimensionless(self, frequency: Any) -> Any:
        return self._of_terms(lambda ground: ground.dimensionless(frequency))

    def in_si(self, gravity: Any) -> Any:
        return self._of_terms(lambda ground: ground.in_si(gravity))

    def _later(self, delay: Any) -> GroundMotion:
        return self._of_terms(lambda ground: ground._later(delay))


@pytree_dataclass
class Sum(_Combination):
    """The sum of several ground motions; a plain function of t counts as one."""

    grounds: tuple[Any, ...] = part()

    def __post_init__(self) -> None:
        object.__setattr__(self, "grounds", tuple(self.grounds))
        if not self.grounds:
            raise InvalidInput("grounds", "()", "must hold at least one ground motion")
        for i, ground in enumerate(self.grounds):
            require_ground(f"grounds[{i}]", ground)
        records = enumerate(records_in(self), 1)
        require_one_time_unit({f"grounds, record {i}": x for i, x in records})

    def _terms(self) -> list[GroundMotion]:
        return [as_motion(ground) for ground in self.grounds]

    def _combined(self, values: Sequence[Any]) -> Any:
        return sum(values)

    def _of_terms(self, convert: Callable[[GroundMotion], GroundMotion]) -> Sum:
        return type(self)(tuple(convert(ground) for ground in self._terms()))


@pytree_dataclass
class SupportMotions(Sum):
    """The motion of each support, by number: ``ground=(u0, u1, …)``, or by ``travelling``.

    Its own acceleration is that of support 0, relative to which displacements are.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        for k, ground in enumerate(self.grounds):
            if support_counts(ground):
                raise InvalidInput(f"grounds[{k}]", repr(ground), "must be of one support")

    def unresolved(self, dt: float) -> list[str]:
        """Sentences on the parts that steps of ``dt`` do not resolve, of those alike one."""
        return [*dict.fromkeys(super().unresolved(dt))]

    def _combined(self, values: Sequence[Any]) -> Any:
        return values[0]


def support_counts(ground: GroundLike) -> set[int]:
    """The numbers of supports of which the parts of a motion are; empty if all move alike."""
    ground = by_supports(ground)
    if isinstance(ground, SupportMotions):
        return {len(ground.grounds)}
    terms = ground._terms() if isinstance(ground, _Combination) else ()
    return {count for term in terms for count in support_counts(term)}


@pytree_dataclass
class Scaled(_Combination):
    """A ground motion times a real factor."""

    ground: Any = part()
    factor: Any = parameter("", words="factor of the ground motion", single=True)

    def __post_init__(self) -> None:
        require_ground("ground", self.ground)
        check(self)

    def unresolved(self, dt: float) -> list[str]:
        """Sentences on the parts that steps of ``dt`` do not resolve; none for a factor of 0."""
        return super().unresolved(dt) if np.any(self.factor) else []

    def energy(self, since: float) -> float | None:
        """The factor's square times that of the ground motion."""
        energy, factor = as_motion(self.ground).energy(since), float(self.factor)
        return None if energy is None else factor * factor * energy  # a power raises overflow

    def _terms(self) -> list[GroundMotion]:
        return [as_motion(self.ground)]

    def _combined(self, values: Sequence[Any]) -> Any:
        return self.factor * values[0]

    def _of_terms(self, convert: Callable[[GroundMotion], GroundMotion]) -> Scaled:
        return Scaled(convert(as_motion(self.ground)), self.factor)


@pytree_dataclass
class _Late(GroundMotion):
    """A ground motion, as it is from its own t = 0 on, that begins at ``delay``, after rest."""

    ground: Any = part()
    delay: Any = parameter("", "time", "delay", single=True)

    @property
    def duration(self) -> Any:
        """Time after which it is over; None if that is unknown."""
        own = getattr(self.ground, "duration", None)
        return None if own is None else self.delay + own

    @property
    def velocity(self) -> Any:  # type: ignore[override]
        """u'(t), from rest; None if it is unknown."""
        if (velocity := as_motion(self.ground).velocity) is None:
            return None
        return lambda t: velocity(since := self._since(t)) - velocity(0 * since)

    def acceleration(self, t: ArrayLike) -> Any:
        return jnp.where(self._begun(t), as_motion(self.ground).acceleration(self._since(t)), 0.0)

    def samples_at(self, t: np.ndarray) -> Any:
        since = self._since(t)
        since = since if is_traced(since) else np.asarray(since)
        return jnp.where(self._begun(t), as_motion(self.ground).samples_at(since), 0.0)

    def unresolved(self, dt: float) -> list[str]:
        return as_motion(self.ground).unresolved(dt)

    def _begun(self, t: ArrayLike) -> Any:
        # An instant of the grid may be rounded to just before it.
        return jnp.asarray(t) >= (1 - 1e-6) * self.delay

    def _since(self, t: ArrayLike) -> Any:
        return (jnp.asarray(t) - self.delay).clip(0)


def mean_acceleration(velocity: Callable[[Any], Any], t: Any, h: float) -> Any:
    """Mean of u'' from t − h/2 to t + h/2, at t = 0 from there on, by the velocity u'."""
    is_first = jnp.asarray(t) <= 0
    begin = jnp.where(is_first, t, t - h / 2)
    return (velocity(t + h / 2) - velocity(begin)) / jnp.where(is_first, h / 2, h)


def require_one_time_unit(records: Mapping[str, GroundMotion]) -> None:
    """An ``InvalidInput`` for records, by name, of which one is in another unit than the first."""
    for name, record in records.items():
        if record.time_unit != (first := next(iter(records.values()))).time_unit:
            raise InvalidInput(name, repr(record), f"must be in the same unit of time as {first!r}")


def records_in(ground: GroundLike) -> Iterator[GroundMotion]:
    """The parts of a ground motion that have a unit of time, such as records: they are in g."""
    return (part for part in as_motion(ground).parts() if part.time_unit)


def require_seconds(name: str, record: Any) -> None:
    """An ``InvalidInput`` for a motion that is not in seconds."""
    if (unit := record.time_unit) != SECONDS:
        problem = f"is in units of {unit} already" if unit else "has no unit of time"
        raise InvalidInput(name, repr(record), f"must be in seconds, but {problem}")


def require_ground(name: str, value: Any) -> None:
    """An ``InvalidInput`` for a value that is neither a ground motion nor a function of t."""
    value = by_supports(value)
    if not (callable(value) or isinstance(value, Ground)):
        hint = "; a tuple has the motion of each support" * isinstance(value, list)
        hint = hint or instead(value, "Record")
        rule = f"must have acceleration(t) or be a function of t{hint}"
        raise InvalidInput(name, repr(value), rule)
