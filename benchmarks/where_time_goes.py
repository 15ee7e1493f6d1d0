"""Where a batch's time goes: by part of the step, and by the number of runs a core takes at a time.

    pip install -e ".[bench]" && python benchmarks/where_time_goes.py

One core, float64, five-wavelet earthquakes, 500 steps, in processor time. JAX's profiler times each
loop over the batch that XLA has made ("operation" below); the source line that it belongs to tells
the part of the step. The profiler's own time for an event is taken off.
"""

import collections
import pathlib
import re
import tempfile
import time

import jax
import numpy as np
from batches import DESIGN, GRID, demand, designed, draw
from jax.profiler import ProfileData

PARTS = {
    "ground": "wavelets.py motion.py",
    "rods": "law.py laws.py zener.py",
    "memories of the rods": "history.py",
    "friction": "coulomb.py friction.py",
    "masses and links": "step.py constants.py coupled.py group.py motion.py state.py ends.py",
    "scalars": "tally.py link_tally.py peaks.py run.py demand.py",
    "blocks, and what reverse mode keeps": "scan.py blocks.py quotients.py derivatives.py",
}
SIZES = (64, 128, 256, 384, 480, 512, 544, 640, 960, 1024)


def value(amplitude, periods, arrivals, friction):
    """Min gap of each run."""
    return jax.vmap(lambda *x: demand(*x).min_gap)(amplitude, periods, arrivals, friction)


def slopes(amplitude, periods, arrivals, friction):
    """The mean of min gap with its gradient by friction and four relaxation times."""

    def mean(design):
        each = jax.vmap(designed, (None, 0, 0, 0))
        return each(design, amplitude, periods, arrivals).mean()

    return jax.value_and_grad(mean)(DESIGN)


def seconds(program, batch):
    """Processor time of a call."""
    start = time.process_time()
    jax.block_until_ready(program(*batch))
    return time.process_time() - start


def traced(program, batch):
    """Time in s and number of calls of each operation."""
    times, calls = collections.Counter(), collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            jax.block_until_ready(program(*batch))
        (file,) = pathlib.Path(folder).rglob("*.xplane.pb")
        for plane in ProfileData.from_file(str(file)).planes:
            for event in (event for line in plane.lines for event in line.events):
                if "hlo_op" in dict(event.stats):
                    times[event.name] += event.duration_ns * 1e-9
                    calls[event.name] += 1
    return times, calls


def files(text):
    """The source file of each operation of a compiled program."""

    def table(name, field):
        (lines,) = re.findall(rf"^{name}\n((?:\d+ .*\n)+)", text, re.MULTILINE)
        rows = (line.split(" ", 1) for line in lines.splitlines())
        return {int(i): re.search(field, rest)[1] for i, rest in rows}

    names = table("FileNames", r'([^/"]*)"$')
    located = table("FileLocations", r"file_name_id=(\d+)")
    frames = table("StackFrames", r"file_location_id=(\d+)")
    found = re.findall(r"^ *(?:ROOT )?%?(\S+) = .*stack_frame_id=(\d+)", text, re.MULTILINE)
    return {name: names[int(located[int(frames[int(frame)])])] for name, frame in found}


def profile(name, function, batch):
    """Print the share of each part in a call."""
    program = jax.jit(function).lower(*batch).compile()
    whole = min(seconds(program, batch) for _ in range(7))
    profiles = [traced(program, batch) for _ in range(5)]
    calls = profiles[0][1]
    times = {operation: min(found[operation] for found, _ in profiles) for operation in calls}
    of_an_event = max(sum(times.values()) - whole, 0.0) / sum(calls.values())
    of = files(program.as_text())
    shares, numbers = collections.Counter(), collections.Counter()
    for operation, t in times.items():
        kinds = [part for part, known in PARTS.items() if of.get(operation, "?") in known.split()]
        part = kinds[0] if kinds else "copies and the rest"
        shares[part] += max(t - calls[operation] * of_an_event, 0.0)
        numbers[part] += calls[operation]
    n, steps = len(batch[0]), GRID.n_steps
    count = sum(calls.values())
    print(f"\n{name}, {n} runs at a time: {1e6 * whole / n:.1f} µs a run")
    print(f"  {count / steps:.0f} operations a step, {1e9 * whole / n / count:.1f} ns a run each")
    for part, t in shares.most_common():
        share = t / sum(shares.values())
        print(f"  {part:38}{share:6.0%}{numbers[part] / steps:8.1f} operations")


def sizes():
    """Print the time of a run by the number of runs at a time."""
    batches = {n: draw(n) for n in SIZES}
    programs = {
        (name, n): jax.jit(function).lower(*batch).compile()
        for n, batch in batches.items()
        for name, function in (("value", value), ("gradient", slopes))
    }
    times = collections.defaultdict(list)
    for _ in range(7):
        for (name, n), program in programs.items():
            times[name, n].append(seconds(program, batches[n]) / n)
    print("\nRuns at a time" + "".join(f"{n:8}" for n in SIZES))
    for name in ("value", "gradient"):
        each = np.array([min(times[name, n]) for n in SIZES]) * 1e6
        print(f"  {name:9}µs " + "".join(f"{t:8.1f}" for t in each))


if __name__ == "__main__":
    with jax.default_device(jax.devices()[0]):
        for batch in (draw(480), draw(512)):
            profile("min gap", value, batch)
            profile("value and gradient of its mean", slopes, batch)
        sizes()
