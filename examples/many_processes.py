"""One program over the accelerators of several processes: JAX's own multi-process mesh.

Start it once for every process, on one machine or on many, with the same address (that of the
first process), the number of processes and each one's number from 0:

    python examples/many_processes.py localhost:9876 2 0 &
    python examples/many_processes.py localhost:9876 2 1

Under a launcher that JAX knows (Slurm, Open MPI, a TPU pod) ``jax.distributed.initialize()`` needs
no arguments. Every process holds its part of the batch; sums over it go from machine to machine
within the compiled program. (Where chunks need not talk to each other, ``monte_carlo`` does without
it, over the devices of each process, with a ``Storage`` that has a common folder and
``shard=(jax.process_index() + 1, jax.process_count())``.)
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec

import jaxpound as jp

RUNS = 8192


def main(address: str, n_processes: int, process: int) -> None:
    """Probability of pounding and the smallest gap of a batch, on all processes' devices."""
    jax.config.update("jax_enable_x64", True)
    jax.distributed.initialize(address, n_processes, process)

    mesh = jax.make_mesh((jax.device_count(),), ("runs",), axis_types=(AxisType.Auto,))
    split = NamedSharding(mesh, PartitionSpec("runs"))
    indices = np.arange(RUNS)  # every process makes only the part that it holds
    batch = jax.make_array_from_callback((RUNS,), split, lambda part: indices[part])
    scenarios = jp.Scenarios(
        jp.paper.structures(),
        jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3), jp.Uniform(0, 8)),
    )
    grid = jp.TimeGrid.until(20.0, 0.04)

    def gap(index: jax.Array) -> jax.Array:
        z = jax.random.normal(jax.random.fold_in(jax.random.key(0), index), scenarios.dimension)
        return jp.demand(*scenarios.realize(z), grid).min_gap

    @jax.jit
    def answer(batch: jax.Array) -> tuple[jax.Array, jax.Array]:
        gaps = jax.vmap(gap)(batch)
        return jnp.mean(gaps <= 0.5), gaps.min()

    probability, smallest = answer(batch)
    print(
        f"process {jax.process_index()} of {jax.process_count()}, {jax.device_count()} devices: "
        f"P(gap <= 0.5) = {float(probability):.6f}, smallest gap {float(smallest):.9f}"
    )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
