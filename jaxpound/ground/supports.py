"""Ground motions of supports that move apart, as those of a bridge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxpound._checks import Range, Rule, as_tuple, enforce, is_traced, not_negative, number
from jaxpound._errors import InvalidInput
from jaxpound.ground.motion import (
    GroundLike,
    Scaled,
    Sum,
    SupportMotions,
    as_motion,
    by_supports,
    require_ground,
    support_counts,
)

VELOCITY = Range(1, 1e5, "m/s", "200 to 2,000 m/s is usual")
DISTANCE = Range(0, 1e5, "m", "from where the wave comes from")


def travelling(ground: GroundLike, velocity: Any, distances: Sequence[Any]) -> Any:
    """Ground motions of supports that a travelling wave reaches one after the other.

    The motion of support k is u_k(t) = u(t − d_k/v): a wave that travels along a bridge and keeps
    its shape. Before it arrives a support rests. What is lost of coherency by scattering, and
    different soils under the supports, are left out; ``ground=(u0, u1, …)`` takes any motions.

    Raises ``ValueError`` if a velocity is not positive, or a distance is negative or not finite.

    Parameters
    ----------
    ground
        The motion u where the wave comes from: a record, a wavelet, a function of t, or a random
        motion, of which each draw travels. ``Analysis`` has the records of a suite travel.
    velocity
        Apparent velocity v > 0 along the distances, in m/s beside buildings: 200 to 2,000 m/s. The
        apparent velocity is that of the ground's waves over the sine of their angle of incidence;
        infinite, of waves from straight below, it moves all supports alike. Of a random motion it
        may be a ``Distribution``.
    distances
        Distance d_k ≥ 0 of each support from where the motion is u, in m beside buildings.

    Examples
    --------
    >>> record = jp.Record([0.0, 0.3, -0.2, 0.0], dt=0.5)
    >>> wave = jp.travelling(record, velocity=500.0, distances=(0.0, 100.0))
    >>> [round(float(u.acceleration(0.7)), 3) for u in wave.grounds]
    [0.1, 0.3]
    """
    distances = as_tuple("distances", distances)
    if hasattr(ground, "draw"):
        if (travels := getattr(ground, "_travelling", None)) is None:
            rule = "must be a ground motion, or a random one of the library: jp.RandomRicker, …"
            raise InvalidInput("ground", repr(ground), rule)
        return travels(velocity, distances)
    velocity = number("velocity", velocity)
    enforce([Rule("velocity", velocity, velocity > 0, "positive")])
    named = {f"distances[{k}]": x for k, x in enumerate(distances)}
    not_negative(**{name: number(name, x) for name, x in named.items()})
    require_ground("ground", ground)
    if n_supports(ground):
        raise InvalidInput("ground", repr(ground), "must be one motion, not that of each support")
    motion = as_motion(ground)
    delays = [distance / velocity for distance in distances]
    at_once = [not is_traced(delay) and bool(np.all(np.asarray(delay) == 0)) for delay in delays]
    pairs = zip(delays, at_once, strict=True)
    return SupportMotions(tuple(ground if now else motion._later(t) for t, now in pairs))


def require_plausible_wave(velocity: Any, distances: Sequence[Any]) -> None:
    """An ``InvalidInput`` for velocity or distances that are out of range in m/s and m."""
    travelling(lambda t: 0.0 * t, velocity, distances)
    enforce([DISTANCE.of(f"distances[{k}]", x) for k, x in enumerate(distances)])
    if is_traced(velocity) or np.isfinite(velocity):
        enforce([VELOCITY.of("velocity", velocity)])


def at_support(ground: GroundLike, number: int) -> Any:
    """The motion of a support by its number; of motions without supports, that of all."""
    ground = by_supports(ground)
    if not support_counts(ground):
        return ground
    if isinstance(ground, SupportMotions):
        return ground.grounds[number]
    if isinstance(ground, Sum):
        return Sum(tuple(at_support(term, number) for term in ground._terms()))
    assert isinstance(ground, Scaled)
    return Scaled(at_support(ground.ground, number), ground.factor)


def by_each_support(ground: GroundLike, convert: Callable[[Any], Any]) -> Any:
    """A ground motion of which that of each support, or of all, is converted."""
    n = n_supports(ground)
    each = tuple(convert(at_support(ground, k)) for k in range(max(n, 1)))
    return SupportMotions(each) if n else each[0]


def n_supports(ground: GroundLike) -> int:
    """The number of supports of which a ground motion is; 0 if all move alike.

    An ``InvalidInput`` if its parts are of different numbers.
    """
    if len(counts := support_counts(ground)) > 1:
        numbers = " and ".join(map(str, sorted(counts)))
        raise InvalidInput("ground", "", f"must be of as many supports in each part, not {numbers}")
    return max(counts, default=0)


def require_supports(ground: GroundLike, n: int) -> None:
    """An ``InvalidInput`` for motions of supports that are not those of n supports."""
    if (count := n_supports(ground)) not in (0, n):
        rule = f"must be of {n}: structures name {n - 1} beside the ground, by support(k) in ends "
        rule += "or in supports="
        raise InvalidInput(f"ground, motions of {count} supports,", "", rule)
