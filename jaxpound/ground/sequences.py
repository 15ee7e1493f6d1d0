"""Sequences: a mainshock and its aftershocks as one ground motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from jaxpound._checks import Rule, as_tuple, enforce, finite, number
from jaxpound._errors import InvalidInput
from jaxpound._fields import check, parameter, pytree_dataclass
from jaxpound.ground.motion import GroundLike, GroundMotion, Scaled, Sum, as_motion


def sequence(grounds: Sequence[GroundLike], rest: Any) -> ShockSequence:
    """Ground motions one after the other, such as a mainshock and aftershocks, as one.

    In a run each shock finds the buildings as those before have left them: storeys that have
    yielded keep their residual drift. ``starts`` of the result are the instants of the shocks' own
    t = 0, ``duration`` is the end of the last.

    A record is over at its last sample, a ``Pulse`` at its end, a Ricker wavelet two periods after
    its centre. None of them jumps: a record goes linearly to zero at both ends, and what a wavelet
    has before its t = 0 falls into the quiet. Functions and objects of your own begin at their
    t = 0 with what they are there.

    ``rest`` ≥ 0 is the quiet time from the end of a shock to the t = 0 of the next, in the motions'
    unit of time. Choose it so long that the buildings come to rest: with a damping ratio ζ free
    vibration falls to 1 % within 0.73 / ζ natural periods, 15 of them for 5 %.

    Raises ``ValueError`` if there is no motion, or one but the last has no known ``duration``, as
    functions have none; if rest is negative or not finite; if units of time differ.

    Examples
    --------
    >>> mainshock = jp.Record([0.0, 0.3, -0.2, 0.0], dt=0.5)
    >>> aftershock = jp.Record([0.0, 0.1, 0.1, -0.2, 0.0], dt=0.25)
    >>> both = jp.sequence([mainshock, 0.5 * aftershock], rest=20.0)
    >>> both.starts, both.duration
    ([0.0, 21.5], 22.5)
    >>> round(float(both.acceleration(22.25)), 3)  # half of -0.2 g
    -0.1
    """
    return ShockSequence(as_tuple("grounds", grounds), rest)


def sequences_in(ground: GroundLike) -> list[ShockSequence]:
    """The sequences of which a ground motion, maybe a sum or scaling, is made."""
    if isinstance(ground, ShockSequence):
        return [ground]
    parts = ground.grounds if isinstance(ground, Sum) else ()
    parts = (ground.ground,) if isinstance(ground, Scaled) else parts
    return [x for part in parts for x in sequences_in(part)]


@pytree_dataclass
class ShockSequence(Sum):
    """Ground motions one after the other, by ``sequence``."""

    rest: Any = parameter("", "time", "rest between ground motions", least=0, single=True)

    def __post_init__(self) -> None:
        check(self)
        for i, ground in enumerate(self.grounds[:-1]):
            if (duration := getattr(ground, "duration", None)) is None:
                rule = "must have a duration, as records and wavelets do, or be the last"
                raise InvalidInput(f"grounds[{i}]", repr(ground), rule)
            end = number(f"grounds[{i}].duration", duration)
            rule = "one number, finite and not negative"
            enforce([Rule(f"grounds[{i}].duration", end, (end >= 0) & finite(end), rule)])
        super().__post_init__()

    @property
    def starts(self) -> list[Any]:
        """The instants at which the ground motions begin, of their own t = 0."""
        starts: list[Any] = [0.0]
        for ground in self.grounds[:-1]:
            starts.append(starts[-1] + ground.duration + self.rest)
        return starts

    def dimensionless(self, frequency: Any) -> ShockSequence:
        """The sequence, in seconds, in units of 1/ω1 for ω1 = ``frequency`` in rad/s."""
        grounds = (as_motion(ground).dimensionless(frequency) for ground in self.grounds)
        return ShockSequence(tuple(grounds), self.rest * frequency)

    def _terms(self) -> list[GroundMotion]:
        first, *others = super()._terms()
        later = zip(others, self.starts[1:], strict=True)
        return [first, *(ground._later(start) for ground, start in later)]

    def _of_terms(self, convert: Callable[[GroundMotion], GroundMotion]) -> ShockSequence:
        return ShockSequence(tuple(convert(x) for x in super()._terms()), self.rest)

    def _later(self, delay: Any) -> Sum:
        return Sum(tuple(term._later(delay) for term in self._terms()))

    def _make_scaled(self, term: Any, factor: Any) -> Any:
        if term is not self:  # of a difference
            return Scaled(term, factor)
        return ShockSequence(tuple(Scaled(x, factor) for x in self.grounds), self.rest)
