"""A catalogue of fragilities of adjacent buildings that pound, for regional risk.

    python examples/catalogue.py --out catalogue

For pairs of frames by height, ratio of periods, gap, and level or unlevel floors, it writes the
probability of pounding by peak ground acceleration as

- ``pounding.xml``, a fragility model of OpenQuake (NRML 0.5), which assesses one limit state;
- ``fragility.csv``, a damage model of pelicun;
- ``motions.parquet``, a row for each pair and motion: the gap that it needs at 1 g, and the
  derivatives of its logarithm by the numbers of the pair, for those who train surrogates;
- ``spectra.parquet``, a row for each motion: its spectral accelerations and Arias intensity.

Frames are elastic, so that the needed gap is in proportion to the motion: one run tells at which
acceleration every gap closes. Floors of unlevel pairs meet the columns of the neighbour.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from functools import partial
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
GAPS = 0.01, 0.02, 0.05, 0.1, 0.2  # m
STOREY, MASS, DAMPING = 3.0, 300e3, 0.05  # m, kg, first mode
COLUMN = jp.model.Column(rigidity=300e6)  # N m²
MOTION = jp.scenarios.SiteBasedNoise(
    magnitude=6.8, distance=20.0, vs30=400.0, fault="strike-slip", samples=1250, dt=0.02
)
GRID = jp.TimeGrid.until(26.0, dt=0.01)
PERIODS = 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0  # s, of spectra
NUMBERS = "period_left", "period_right", "damping"
NRML = "http://openquake.org/xmlns/nrml/0.5"


def pair(heights: tuple[int, int], floors: str, numbers: jax.Array) -> jp.Buildings:
    """Two frames side by side, without a law of contact; the numbers are ``NUMBERS``."""
    left_period, right_period, damping = numbers
    shifts = 0.0, STOREY / 2 if floors == "unlevel" else 0.0  # of the first storey
    frames = [
        jp.ShearBuilding.from_period(
            n, MASS, period, damping, height=[STOREY + shift] + [STOREY] * (n - 1)
        )
        for n, period, shift in zip(heights, (left_period, right_period), shifts, strict=True)
    ]
    columns = COLUMN if floors == "unlevel" else None
    return jp.Buildings(tuple(frames), jp.floor_links(frames, gap=1.0, columns=columns))


@partial(jax.jit, static_argnums=(0, 1))  # one program for all periods
def log_needed_gaps(
    heights: tuple[int, int], floors: str, numbers: jax.Array, records: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Logarithm of the gap that each motion needs at a peak of 1 g, and its derivatives, (n, 3)."""

    def needed(numbers: jax.Array, samples: jax.Array) -> jax.Array:
        ground = jp.Record(samples, MOTION.dt)
        demand = jp.demand(pair(heights, floors, numbers), ground, GRID, only=["min_gap"])
        return jnp.log(1.0 - demand.min_gap)  # at rest it is 1 m

    return jax.vmap(jax.value_and_grad(needed), (None, 0))(numbers, records)


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


def catalogue(records: jax.Array) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The fragilities, and the runs by which they are, of motions with a peak of 1 g."""
    n, curves, runs = len(records), [], []
    for heights, floors, ratio in itertools.product(HEIGHTS, FLOORS, PERIOD_RATIOS):
        periods = PERIOD_OF_STOREY * np.array(heights) * [1.0, ratio]
        numbers = jnp.array([*periods, DAMPING])
        values, slopes = log_needed_gaps(heights, floors, numbers, records)
        of_pair = {"storeys_left": heights[0], "storeys_right": heights[1], "floors": floors}
        of_pair |= dict(zip(NUMBERS, map(float, numbers), strict=True))
        derivatives = {f"d_{name}": slopes[:, k] for k, name in enumerate(NUMBERS)}
        runs.append(
            pd.DataFrame({**of_pair, "motion": range(n), "log_gap_at_1_g": values, **derivatives})
        )
        for gap in GAPS:
            capacities = np.log(gap) - np.asarray(values)  # ln of the PGA at which it closes, g
            median, dispersion = np.exp(capacities.mean()), capacities.std(ddof=1)
            name = (
                f"pounding_{heights[0]}_{heights[1]}_{floors}_T{100 * ratio:.0f}_{1000 * gap:.0f}mm"
            )
            curve = {"ID": name, **of_pair, "gap": gap, "median": median, "dispersion": dispersion}
            curves.append(curve)
    return pd.DataFrame(curves), pd.concat(runs, ignore_index=True)


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
    arguments.add_argument("--motions", type=int, default=200, help="motions of each pair")
    stated = arguments.parse_args()
    warnings.simplefilter("ignore", jp.PlausibilityWarning)
    records = motions(stated.motions)
    curves, runs = catalogue(records)
    stated.out.mkdir(parents=True, exist_ok=True)
    openquake(curves).write(stated.out / "pounding.xml", "utf-8", xml_declaration=True)
    pelicun(curves).to_csv(stated.out / "fragility.csv", index=False)
    runs.to_parquet(stated.out / "motions.parquet", index=False)
    spectra(records).to_parquet(stated.out / "spectra.parquet", index=False)
    print(f"{len(curves)} fragilities by {len(runs):,} runs, in {stated.out}")


if __name__ == "__main__":
    main()
