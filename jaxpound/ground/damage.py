"""Signs of damage in the values of a file as they are printed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from jaxpound.ground.formats.rows import FEW, MANY, ValueRow, line_of
from jaxpound.ground.formats.text import MisreadError

_SHAPE = str.maketrans("123456789", "000000000")  # the shape of a number: all digits 0


def signs_of_damage(
    rows: list[ValueRow], samples: NDArray[np.float64], ended: bool, notes: list[str]
) -> None:
    """Refuse or note signs of damage: digits of printed values, a last line without a line end."""
    _check_digits(rows, ended, notes)
    peak = np.abs(samples)
    if len(peak) >= MANY and not ended and peak[-1] > peak[:-1].max():
        notes.append("the last line has no end and its value is the largest: is the file cut?")


def _check_digits(rows: list[ValueRow], ended: bool, notes: list[str]) -> None:
    """Refuse a file that is cut inside its last value, which then has fewer digits than others.

    A zero at the end, such as -0 or 0.0, may be the rest of a small value with more digits, unless
    zeros are printed so elsewhere. A value elsewhere with other digits than nearly all is noted: it
    may be damaged.
    """
    numbers = [number for row in rows for number in row.numbers]
    first, behind = numbers[: (n := len(rows[0].numbers))], numbers[n:]
    whole = not any("." in number for number in first) and any(map(float, first))
    if whole and len(behind) > MANY and all("." in number for number in behind):
        rule = "stands ahead of values with decimals: is it of a header, or a count?"
        raise MisreadError(rows[0].line, f"a row of whole numbers {rule}")
    if len(numbers) <= FEW // 2:
        return
    digits = np.array([_digits(number.translate(_SHAPE)) for number in numbers])
    _, decimals, exponents = digits.T
    exponents_before = exponents[:-1][exponents[:-1] > 0]
    uniform = np.ptp(decimals[:-1]) == np.ptp(exponents[:-1]) == 0
    nonzero = float(numbers[-1]) != 0
    shorter = decimals[-1] < decimals[:-1].max() or exponents[-1] < exponents[:-1].max()
    if (
        ((uniform or (len(numbers) > MANY and nonzero)) and decimals[-1] < decimals[:-1].min())
        or (exponents[-1] == 0 and len(exponents_before) == len(numbers) - 1)
        or (exponents[-1] > 0 and len(exponents_before) and exponents[-1] < exponents_before.min())
        or (not ended and not nonzero and shorter and numbers[-1] not in numbers[:-1])
    ):
        message = f"{numbers[-1]} must have the digits of the values ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, message)
    codes = digits @ np.array([10**6, 10**3, 1])  # three numbers, of at most 100 each, as one
    _, form, times = np.unique(codes, return_inverse=True, return_counts=True)
    odd = len(numbers) - times.max()
    if len(numbers) >= MANY and 0 < odd <= max(1, len(numbers) // (10 * MANY)):
        index = int(np.argmax(form != np.argmax(times)))
        place = f"{numbers[index]} in line {line_of(rows, index)}"
        notes.append(f"{place} is printed with other digits than nearly all values: is it damaged?")


@lru_cache(1000)  # numbers have few shapes
def _digits(number: str) -> tuple[int, int, int]:
    """Numbers of digits before the decimal point, after it (-1 without one), in the exponent."""
    mantissa, _, exponent = number.lstrip("+-").partition("E")
    whole, point, decimals = mantissa.partition(".")
    places = len(decimals) if point else -1
    # Without an exponent the digits before the point vary in a file.
    return len(whole) if exponent else 0, places, len(exponent.lstrip("+-"))
