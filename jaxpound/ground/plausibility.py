"""Valid but implausible input, such as a number in a wrong unit: a warning or, if strict, an error.

A dimensionless run checks the PGA only of ground motions with a record, which is in g: eq. 9 is
homogeneous, so that ground, friction and gap may be scaled together. A run in SI checks any, and so
does a Monte Carlo study: its probabilities are those of real earthquakes. Traced values are not
checked.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view as windows

from jaxpound._checks import Range, is_traced
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, GroundLike, as_motion, records_in
from jaxpound.ground.run_input import sampled
from jaxpound.ground.sequences import sequences_in
from jaxpound.ground.supports import at_support, n_supports
from jaxpound.quantities import STANDARD_GRAVITY

LARGE_PGA = 5.0  # peak ground acceleration, g: the largest recorded are about 4
MOST_STATED = 2.0  # g, of a motion that is no record as it was measured: hazard maps end there
MOST_UNSTATED = 1.5  # g, of a record of unstated unit: few records in g exceed it, many in m/s² do
ISOLATED = 4.0  # height of a spike over the steps around it: at most 2.0 in 20 recorded motions
LARGE = 2.5  # its height over the third largest sample: at most 0.8 there
AROUND = 20  # samples on each side of a spike that are looked at
NOTICED = 0.1  # of the peak: lower spikes matter little
MOST_MEAN = 0.02  # mean over the peak; at most 0.0002 in 20 processed records
NINES = [(10**n - 1) / 10**decimals for n in range(2, 10) for decimals in range(n)]  # 9.99, 999
OFFSET = "the mean acceleration"  # first words of a finding about it
SAMPLING = Range(1e-4, 0.1, "s", "accelerographs take 50 to 500 samples a second")
MANY = 100  # least number of samples of a checked record; fewer are an example
MOST_GAP = 100.0  # gap over displacements of a run, whose earthquake may be weak
DEEP = 0.25  # penetration over displacements: real floors stay below a tenth
MOST_RESIDUAL = 0.03  # of the energy balance over the input: the displacements' error is as large
LATE = 0.1  # share of a ground motion's energy, ∫ u''² dt, after the end of a run
LEAST_SHARE = 0.01  # of a study's earthquakes: no probability changes by more
LOOKED_AT = 256  # earthquakes of a study: they include a 1 % event with a probability of 92 %


def of_samples(samples: np.ndarray, dt: float, *, stated: bool) -> list[str]:
    """Findings in the samples of a record in g and seconds; ``stated``: whether its unit was."""
    if len(samples) < MANY:
        return []
    if float(f"{dt:.6g}") not in SAMPLING:  # in single precision 0.1 is more than 0.1
        return [f"dt = {dt:.6g} s should be {SAMPLING.rule}: is it in s?"]
    findings, highest = _spikes(samples, dt), float(np.abs(samples).max())
    if not (stated or findings) and highest > MOST_UNSTATED:
        advice = 'state units="m/s2", or units="g" if that is right'
        findings = [f"no unit is stated, and in g the peak is {highest:.4g} g: {advice}"]
    return findings + offset(samples, dt)


def offset(samples: np.ndarray, dt: float) -> list[str]:
    """A finding if the mean of a record in g and seconds is too large a share of its peak."""
    mean, peak = float(np.mean(samples, dtype=float)), float(np.abs(samples).max())
    if len(samples) < MANY or not abs(mean) > MOST_MEAN * peak:
        return []
    speed = abs(mean) * STANDARD_GRAVITY * (duration := (len(samples) - 1) * dt)
    size = f"{mean:.4g} g, is {abs(mean) / peak:.1%} of the peak and should be at most"
    effect = f"the ground ends {speed * duration / 2:.3g} m away, at {speed:.3g} m/s"
    cure = "record.without_mean(), .detrended() or .high_passed(corner) removes it"
    return [f"{OFFSET}, {size} {MOST_MEAN:.0%}: by it alone {effect}; {cure}"]


def missing_code(values: np.ndarray) -> tuple[float, int, int] | None:
    """A code of missing values, of nines such as -999 or 99.99: itself, its first index, its count.

    ``values``, shape (n,), are as printed. A code occurs at least twice, and all other values are
    below half of it, or three times in a row and most values beside it are as far away.
    """
    codes = values[np.isin(sizes := np.abs(values), NINES)].tolist()
    for code in sorted({*codes}, key=abs, reverse=True):
        is_code, is_far = values == code, np.abs(values - code) > abs(code) / 2
        n, is_beside = int(is_code.sum()), np.convolve(is_code, [1, 0, 1], "same") * ~is_code > 0
        alone = n > 1 and sizes[sizes != abs(code)].max(initial=0) < abs(code) / 2
        in_a_row = n > 2 and windows(is_code, 3).all(-1).any()
        if alone or (in_a_row and is_far[is_beside].mean() > 0.5):
            return code, int(is_code.argmax()), n
    return None


def _spikes(samples: np.ndarray, dt: float) -> list[str]:
    """A finding if one or two samples together stand out of those around them.

    Their height, what is narrower than three samples by morphological opening and closing (the
    top-hat transform), is compared with the steps around them, and with the third largest sample:
    where that is 0, an impulse is meant.
    """
    padded = np.pad(samples, 2)
    opened = windows(windows(padded, 3).min(-1), 3).max(-1)
    closed = windows(windows(padded, 3).max(-1), 3).min(-1)
    height = np.maximum(samples - opened, closed - samples)
    # The steps of a spike of two samples are among the two on either side of each.
    steps = windows(np.abs(np.diff(np.pad(samples, AROUND + 2))), AROUND).max(-1)
    around = np.maximum(steps[: len(samples)], steps[-len(samples) :])
    third, _, peak = np.partition(np.abs(samples), [-3, -1])[-3:]
    least = np.maximum(NOTICED * peak, np.minimum(ISOLATED * around, LARGE * third))
    stands = (height > least) & (third > 0)
    if not (n := int(stands.sum())):
        return []
    largest = int(np.argmax(stands * height))
    subject = f"acceleration[{largest}] = {samples[largest]:.4g} g, at {largest * dt:.6g} s,"
    also = f" (one of {n}, the first at {np.argmax(stands) * dt:.6g} s)" if n > 1 else ""
    rise = f"stands alone, {height[largest]:.4g} g beyond the samples beside it{also};"
    return [f"{subject} {rise} steps around are up to {around[largest]:.4g} g: is it damaged?"]


def unseen(ground: GroundLike, grid: TimeGrid, *, strict: bool = False) -> list[str]:
    """Findings if a grid does not resolve a ground motion, or ends before much of its energy.

    If ``strict``, also those of which its records have warned as they were made.
    """
    if is_traced(ground):
        return []
    earlier = [x for record in records_in(ground) for x in getattr(record, "doubts", ())]
    findings = [*as_motion(ground).unresolved(grid.dt), *_late(ground, grid), *strict * earlier]
    return [*dict.fromkeys(findings)]  # a record that travels has its doubts at each support


def _late(ground: GroundLike, grid: TimeGrid) -> list[str]:
    starts = [float(start) for x in sequences_in(ground) for start in x.starts]
    if (last := max(starts, default=0.0)) >= grid.duration:
        begins = f"a shock of the sequence begins at {last:.4g}, after the end of the run"
        return [f"ground: {begins}: a longer time grid holds it"]
    whole, later = (as_motion(ground).energy(t) for t in (-np.inf, grid.duration))
    if not (whole and later and later > LATE * whole):
        return []
    share = f"{later / whole:.0%} of the motion's energy (∫ u''² dt) comes after the end of the run"
    return [f"ground: {share}, and should be at most {LATE:.0%}: a longer time grid holds it"]


def excessive(ground: GroundLike, pga: Any, name: str = "ground", *, si: bool) -> list[str]:
    """A finding if a ground motion in SI, or in g as a record is, exceeds the plausible PGA, g."""
    if is_traced(pga) or jnp.ndim(pga) or not (si or any(records_in(ground))):
        return []
    most = MOST_STATED if si and not getattr(as_motion(ground), "measured", False) else LARGE_PGA
    return [_beyond(f"{name}: PGA = {float(pga):.4g} g", most)] if float(pga) > most else []


def far_apart(name: str, gap: Any, moved: Any, *, si: bool) -> list[str]:
    """A finding if a gap is out of proportion to the displacements, peak |x1| + peak |x2|."""
    if not _exceeds(gap, MOST_GAP, moved):
        return []
    most = f"{MOST_GAP:g} times {_moves(moved, si)}"
    return [f"{name} = {_length(gap, si)} should be at most {most}: are the units right?"]


def too_deep(name: str, penetration: Any, moved: Any, *, si: bool) -> list[str]:
    """A finding if a contact law is implausibly soft; None is a link without a law."""
    if penetration is None or not _exceeds(penetration, DEEP, moved):
        return []
    most, depth = f"{DEEP:g} of {_moves(moved, si)}", _length(penetration, si)
    return [f"{name}: the penetration, {depth}, should be at most {most}: is the law stiff enough?"]


def _exceeds(length: Any, share: float, moved: Any) -> bool:
    """Whether a length exceeds this share of the displacements; False for traced numbers."""
    if is_traced((length, moved)) or jnp.ndim(moved):
        return False
    return float(length) > share * float(moved)


def _length(value: Any, si: bool) -> str:
    return f"{float(value):.4g} {'m' if si else 'g/ω1²'}"


def _moves(moved: Any, si: bool) -> str:
    return f"what the buildings move, {_length(moved, si)} (peaks of both its sides)"


def unbalanced(residual: Any) -> list[str]:
    """A finding if the residual of a run's energy balance is too large a share of the input."""
    if not float(residual) > MOST_RESIDUAL:
        return []
    left = f"{100 * float(residual):.2g} % of the energy put in"
    advice = "the time step is too long for this run (half of it leaves a quarter)"
    rule = f"which should be at most {100 * MOST_RESIDUAL:g} %"
    return [f"the energy balance leaves {left}, {rule}: {advice}"]


def first_of(n: int, grid: TimeGrid) -> int:
    """Number of n earthquakes that are checked, fewer if they are long, to save time."""
    return min(n, LOOKED_AT, max(16, 2**20 // grid.n_steps))


def of_many(grounds: Ground, grid: TimeGrid, *, in_g: bool) -> list[str]:
    """Findings in n earthquakes of a study, with a leading axis; ``in_g``: even without records."""
    n, findings = len(jax.tree.leaves(grounds)[0]), []
    arrays = jax.tree.map(np.asarray, grounds)
    each = [jax.tree.map(lambda x, i=i: x[i], arrays) for i in range(n)]
    problems = {
        "are not resolved": [as_motion(ground).unresolved(grid.dt) for ground in each],
        "outlast the run": [_late(ground, grid) for ground in each],
    }
    for problem, findings_of_each in problems.items():
        examples = [x[0].removeprefix("ground: ") for x in findings_of_each if x]
        if len(examples) > LEAST_SHARE * n:
            findings.append(f"ground: {_share(len(examples), n)} {problem}; of one, {examples[0]}")
    if in_g or any(records_in(grounds)):
        pgas = np.asarray(_pgas(grounds, grid))
        if (beyond := int((pgas > LARGE_PGA).sum())) > LEAST_SHARE * n:
            subject = f"ground: PGA of {_share(beyond, n)}, up to {np.nanmax(pgas):.4g} g,"
            findings.append(_beyond(subject))
    return findings


@partial(jax.jit, static_argnames="grid")
def _pgas(grounds: Ground, grid: TimeGrid) -> jax.Array:
    def pga(ground: Ground) -> jax.Array:
        motions = [at_support(ground, k) for k in range(max(n_supports(ground), 1))]
        return jnp.stack([jnp.abs(sampled(x, grid).samples).max() for x in motions]).max()

    return jax.vmap(pga)(grounds)


def _share(count: int, n: int) -> str:
    return f"{count / n:.0%} of the {n} earthquakes looked at"


def _beyond(subject: str, most: float = LARGE_PGA) -> str:
    return f"{subject} should be at most {most:.0f} g: are the units right?"
