"""A catalogue of fragilities of adjacent buildings that pound, for regional risk.

    python examples/catalogue.py --out catalogue

For pairs of frames by height, ratio of periods, strength, gap, and level or unlevel floors, it
computes the probability of pounding by peak ground acceleration (PGA), and writes

- ``pounding.xml``, a fragility model of OpenQuake (NRML 0.5), which assesses one limit state;
- ``fragility.csv``, a damage model of pelicun;
- ``motions.parquet``, a row for each pair, PGA and motion: the gap that it needs, and the
  derivatives of its logarithm by the numbers of the pair, for those who train surrogates;
- ``spectra.parquet``, a row for each motion: its spectral accelerations and Arias intensity.

Springs of storeys are bilinear. Twice the strength and twice the PGA make all displacements twice
as large, so that runs at one strength tell the gaps of every other. Floors of unlevel pairs meet
the columns of the neighbour.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

jax.config.update("jax_enable_x64", True)

import jaxpound as jp  # noqa: E402

HEIGHTS = (2, 2), (2, 4), (4, 4), (4, 8), (8, 8)  # storeys, left and right
PERIOD_OF_STOREY = 0.1  # s, of concrete frames
PERIOD_RATIOS = 0.6, 0.8, 0.95  # of the right building to 0.1 s a storey; the left one has 1
FLOORS = "level", "unlevel"
STRENGTHS = {"elastic": 1e9, "C30": 0.3, "C20": 0.2, "C10": 0.1}  # base shear at yield over weight
GAPS = 0.01, 0.02, 0.05, 0.1, 0.2  # m
STOREY, MASS, DAMPING, HARDENING = 3.0, 300e3, 0.05, 0.03  # m, kg, first mode, after yield
COEFFICIENT = 0.1  # base shear at yield over weight, of the runs
LEVELS = np.r_[0.01, np.geomspace(0.04, 2.0, 9)]  # PGA of the runs, g; at the lowest none yields
COLUMN = jp.model.Column(rigidity=300e6)  # N m²; any will do, as frames do not touch
MOTION = jp.scenarios.SiteBasedNoise(
    magnitude=6.8, distance=20.0, vs30=400.0, fault="strike-slip", samples=1250, dt=0.02
)
GRID = jp.TimeGrid.until(26.0, dt=0.005)
PERIODS = 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0  # s, of spectra
NUMBERS = "period_left", "period_right", "damping", "base_shear_coefficient"
NRML = "http://openquake.org/xmlns/nrml/0.5"


def pair(heights: tuple[int, int], floors: str, numbers: jax.Array) -> jp.Buildings:
    """Two frames side by side, without a law of contact; the numbers are ``NUMBERS``."""
    left_period, right_period, damping, coefficient = numbers
    shifts = 0.0, STOREY / 2 if floors == "unlevel" else 0.0  # of the first storey
    frames = [
        jp.ShearBuilding.from_period(
            n, MASS, period, damping, height=[STOREY + shift] + [STOREY] * (n - 1)
        ).yielding(base_shear_coefficient=coefficient, hardening=HARDENING)
        for n, period, shift in zip(heights, (left_period, right_period), shifts, strict=True)
    ]
    columns = COLUMN if floors == "unlevel" else None
    return jp.Buildings(tuple(frames), jp.floor_links(frames, gap=1.0, columns=columns))


def closing_weights(linked: jp.Buildings) -> np.ndarray:
    """The closing of every link by the displacements of the floors, (links, floors)."""
    system = linked.system()
    weights = np.zeros((len(system.links), len(system.masses)))
    for row, link in zip(weights, system.links, strict=True):
        if link.weights:  # at a column, which moves as the floors below and above it do
            row[list(link.ends.masses)] = link.weights
        else:
            row[list(link.ends)] = 1.0, -1.0
    return weights


def peak(y: jax.Array) -> jax.Array:
    """The largest of a series, also between its instants, by a parabola."""
    k = jnp.argmax(y[1:-1]) + 1
    before, top, after = y[k - 1], y[k], y[k + 1]
    end = jnp.maximum(before, after)  # above the top only at an end of the series
    return jnp.where(end > top, end, top - (after - before) ** 2 / (8 * (after - 2 * top + before)))


@cache  # one program for all periods
def log_needed_gaps(
    heights: tuple[int, int], floors: str
) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """A function of numbers, (n, 4), and motions in g: logarithm of the gaps that they need.

    With it come its derivatives by the numbers, (n, 4). Frames that do not touch move by
    themselves: runs are without links.
    """

    def log_gap(numbers: jax.Array, samples: jax.Array) -> tuple[jax.Array, jax.Array]:
        linked = pair(heights, floors, numbers)
        frames = jp.Buildings(linked.buildings, ())
        response = jp.simulate(frames, jp.Record(samples, MOTION.dt), GRID)
        x = jnp.stack([mass.x for mass in response.masses])
        value = jnp.log(jax.vmap(peak)(closing_weights(linked) @ x).max())
        return value, value

    def run(numbers: jax.Array, samples: jax.Array) -> tuple[jax.Array, jax.Array]:
        slopes, value = jax.jacfwd(log_gap, has_aux=True)(numbers, samples)
        return value, slopes

    return jp.runtime.in_chunks(run, chunk_size=128)


def motions(n: int) -> jax.Array:
    """The samples of n motions with a peak of 1 g."""
    z = jax.random.normal(jax.random.key(0), (n, MOTION.dimension))
    records = jax.lax.map(lambda x: MOTION.draw(x).samples, z, batch_size=50)
    return records / abs(records).max(1, keepdims=True)


def spectra(records: jax.Array) -> pd.DataFrame:
    """A row for each motion: spectral accelerations at ``PERIODS`` in g, Arias intensity in g s."""

    def intensities(samples: jax.Array) -> dict[str, jax.Array]:
        record = jp.Record(samples, MOTION.dt, units="g")
        accelerations = {
            f"sa_{period:g}_s": jp.spectral_acceleration(record, period=period)
            for period in PERIODS
        }
        return {**accelerations, "arias": jp.ground.arias_intensity(record)}

    columns = jax.jit(jax.vmap(intensities))(records)
    return pd.DataFrame({"motion": range(len(records)), **columns})


def runs(records: np.ndarray) -> Iterator[pd.DataFrame]:
    """Of every pair, a table of its runs: each level of PGA with every motion of 1 g."""
    samples = (LEVELS[:, None, None] * records).reshape(-1, records.shape[1])
    for heights, floors, ratio in itertools.product(HEIGHTS, FLOORS, PERIOD_RATIOS):
        periods = PERIOD_OF_STOREY * np.array(heights) * [1.0, ratio]
        numbers = np.array([*periods, DAMPING, COEFFICIENT])
        needed = log_needed_gaps(heights, floors)
        values, slopes = needed(np.tile(numbers, (len(samples), 1)), samples)
        if slopes[: len(records), NUMBERS.index("base_shear_coefficient")].any():
            words = f"storeys yield at the lowest of LEVELS, {LEVELS[0]} g; make it smaller"
            raise ValueError(words)
        frames = {"storeys_left": heights[0], "storeys_right": heights[1], "floors": floors}
        frames |= dict(zip(NUMBERS, numbers, strict=True))
        results = {
            "pga": np.repeat(LEVELS, len(records)),
            "motion": np.tile(np.arange(len(records)), len(LEVELS)),
            "log_gap": values,
        }
        results |= {f"d_{name}": slopes[:, k] for k, name in enumerate(NUMBERS)}
        yield pd.DataFrame({**frames, **results})


def capacities(log_gaps: np.ndarray, gap: float) -> np.ndarray:
    """PGA at which each motion first needs the gap, g; infinite if it does at no level.

    The logarithms of needed gaps have a row for each level; below them frames are elastic.
    """
    levels = np.log(np.r_[1e-12, LEVELS])
    log_gaps = np.vstack([log_gaps[0] + levels[0] - levels[1], log_gaps]) - np.log(gap)
    after = np.maximum((log_gaps >= 0).argmax(0), 1)
    high, low = (np.take_along_axis(log_gaps, k[None], 0)[0] for k in (after, after - 1))
    share = high / (high - low)
    crossing = np.exp(share * levels[after - 1] + (1 - share) * levels[after])
    return np.where((log_gaps >= 0).any(0), crossing, np.inf)


def fragilities(table: pd.DataFrame) -> Iterator[dict[str, object]]:
    """The curves of a pair by its runs, where at least half of the motions close the gap."""
    frames = table.iloc[0]
    log_gaps = table.log_gap.to_numpy().reshape(len(LEVELS), -1)
    ratio = frames.period_right / (PERIOD_OF_STOREY * frames.storeys_right)
    for (strength, coefficient), gap in itertools.product(STRENGTHS.items(), GAPS):
        times = coefficient / COEFFICIENT  # as strong as in the runs
        reached = times * capacities(log_gaps, gap / times)
        if np.isfinite(reached).mean() < 0.5:
            continue
        curve = jp.hazard.fit_capacities(reached, analysed=times * LEVELS[-1])
        heights = f"{frames.storeys_left}_{frames.storeys_right}_{frames.floors}"
        name = f"pounding_{heights}_T{100 * ratio:.0f}_{strength}_{1000 * gap:.0f}mm"
        yield {"ID": name, "median": curve.median, "dispersion": curve.dispersion}


def openquake(curves: pd.DataFrame) -> ElementTree.ElementTree:
    """A fragility model, whose numbers are mean and standard deviation of the capacity itself."""
    root = ElementTree.Element("nrml", xmlns=NRML)
    categories = {"assetCategory": "buildings", "lossCategory": "structural"}
    model = ElementTree.SubElement(root, "fragilityModel", id="pounding", **categories)
    words = "Pounding of adjacent frames, by jaxpound"
    ElementTree.SubElement(model, "description").text = words
    ElementTree.SubElement(model, "limitStates").text = "pounding"
    for curve in curves.itertuples():
        form = {"format": "continuous", "shape": "logncdf"}
        function = ElementTree.SubElement(model, "fragilityFunction", id=curve.ID, **form)
        levels = {"imt": "PGA", "noDamageLimit": "0.001", "minIML": "0.001", "maxIML": "10.0"}
        ElementTree.SubElement(function, "imls", levels)
        mean = curve.median * np.exp(curve.dispersion**2 / 2)
        deviation = mean * np.sqrt(np.expm1(curve.dispersion**2))
        numbers = {"mean": f"{mean:.8g}", "stddev": f"{deviation:.8g}"}
        ElementTree.SubElement(function, "params", ls="pounding", **numbers)
    ElementTree.indent(root)
    return ElementTree.ElementTree(root)


def pelicun(curves: pd.DataFrame) -> pd.DataFrame:
    """A damage model, whose numbers are median and dispersion."""
    fixed = {
        "Incomplete": 0,
        "Demand-Type": "Peak Ground Acceleration",
        "Demand-Unit": "g",
        "Demand-Offset": 0,
        "Demand-Directional": 0,
        "LS1-Family": "lognormal",
    }
    numbers = {"LS1-Theta_0": curves["median"], "LS1-Theta_1": curves["dispersion"]}
    return pd.DataFrame({"ID": curves["ID"], **fixed, **numbers})


def main() -> None:
    """Compute and write."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--out", type=Path, required=True, help="folder of the files")
    arguments.add_argument("--motions", type=int, default=50, help="motions of each pair")
    stated = arguments.parse_args()
    warnings.simplefilter("ignore", jp.PlausibilityWarning)
    jp.runtime.use_cores()
    records = np.asarray(motions(stated.motions))
    tables = list(runs(records))
    curves = pd.DataFrame([curve for table in tables for curve in fragilities(table)])
    stated.out.mkdir(parents=True, exist_ok=True)
    openquake(curves).write(stated.out / "pounding.xml", "utf-8", xml_declaration=True)
    pelicun(curves).to_csv(stated.out / "fragility.csv", index=False)
    table = pd.concat(tables, ignore_index=True)
    table.to_parquet(stated.out / "motions.parquet", index=False)
    spectra(records).to_parquet(stated.out / "spectra.parquet", index=False)
    print(f"{len(curves)} fragilities by {len(table):,} runs, in {stated.out}")


if __name__ == "__main__":
    main()
