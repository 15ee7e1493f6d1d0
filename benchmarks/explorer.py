"""How long a slider's change takes until its picture is there: python benchmarks/explorer.py."""

from time import perf_counter

import jax
import numpy as np

import jaxpound as jp
from jaxpound.plots.explorer import Explorer

jax.config.update("jax_enable_x64", True)
CHANGES = 200


def main():
    explorer = Explorer(jp.paper.structures(), jp.paper.ground(), jp.TimeGrid.until(20.0, 0.02))
    rng, times = np.random.default_rng(0), []
    names = [name for name in explorer.sliders if not name.endswith("tau_f")]
    for _ in range(CHANGES):
        position = explorer.sliders[names[rng.integers(len(names))]].position
        step = round(rng.normal() * position.max / 10) or 1
        start = perf_counter()
        position.value = (position.value + step) % (position.max + 1)
        times.append(perf_counter() - start)
    median, most = np.median(times), max(times)
    print(f"{CHANGES} changes of random sliders, 1,000 steps each: from the change to its picture")
    print(f"median {1e3 * median:.0f} ms, longest {1e3 * most:.0f} ms")


if __name__ == "__main__":
    main()
