"""Where a user's first seconds go: imports, tracing, compiling, running, drawing.

    pip install -e ".[bench,notebooks]" && python benchmarks/first_seconds.py

Processor time, each row in a process of its own, the shortest of three; no program is kept from an
earlier run, but for the second run of ``jaxpound paper``.
"""

import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

CLEAN = {name: x for name, x in os.environ.items() if "CACHE" not in name}
NOTEBOOKS = sorted((pathlib.Path(__file__).parents[1] / "notebooks").glob("0*.ipynb"))

IMPORTS = """
import time
start = time.process_time()
import jax
jax_ = time.process_time()
import matplotlib.pyplot
pyplot = time.process_time()
import jaxpound.plots
jaxpound.simulate
end = time.process_time()
print(jax_ - start, pyplot - jax_, end - pyplot)
"""

FIRST_RUN = """
import time
import jax
jax.config.update("jax_enable_x64", True)
import jaxpound as jp
import matplotlib.pyplot
start = time.process_time()
case = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
lowered = jax.jit(lambda s, g: jp.simulate(s, g, case[2])).lower(*case[:2])
traced = time.process_time()
lowered.compile()
compiled = time.process_time()
program = jax.jit(lambda s, g: jp.simulate(s, g, case[2]))
first = program(*case[:2])
jax.block_until_ready(first)
before = time.process_time()
jax.block_until_ready(program(*case[:2]))
ran = time.process_time()
first.plot()
matplotlib.pyplot.gcf().canvas.draw()
print(traced - start, compiled - traced, ran - before, time.process_time() - ran)
"""

CELLS = """
import contextlib, io, sys, time
from IPython.core.interactiveshell import InteractiveShell
import json
shell = InteractiveShell.instance()
cells = json.loads(sys.argv[1])
times = []
for cell in cells:
    start = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        assert shell.run_cell(cell).success
    times.append(time.process_time() - start)
print(times[0] + times[1], sum(times[2:]))
"""


def best(code, *args, folder=None):
    """The shortest of three times of each part that a program prints."""
    runs = []
    for _ in range(3):
        output = subprocess.run(
            [sys.executable, "-c", code, *args],
            capture_output=True,
            check=True,
            text=True,
            cwd=folder,
            env=CLEAN | {"MPLBACKEND": "Agg"},
        ).stdout
        runs.append([float(x) for x in output.splitlines()[-1].split()])
    return [min(times) for times in zip(*runs, strict=True)]


def commands():
    """Processor time of ``jaxpound paper``, without and with programs that an earlier run kept."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [sys.executable, "-m", "jaxpound", "paper", "--out", f"{folder}/results"],
                check=True,
                capture_output=True,
                env=CLEAN | {"JAXPOUND_CACHE": f"{folder}/cache"},
            )
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return times


def main():
    print("Processor time in s")
    print("  imports: JAX {:.2f}, Matplotlib {:.2f}, jaxpound {:.2f}".format(*best(IMPORTS)))
    words = "  first simulate: traced {:.2f}, compiled {:.2f}, ran {:.3f}, drawn {:.2f}"
    print(words.format(*best(FIRST_RUN)))
    print("  jaxpound paper: first {:.1f}, again {:.1f}".format(*commands()))
    print("  notebook: parameters and imports, and the cell after them")
    for notebook in NOTEBOOKS:
        cells = json.loads(notebook.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        times = best(CELLS, json.dumps(code[:3]), folder=notebook.parent)
        print("    {:42}{:5.2f}{:7.2f}".format(notebook.stem, *times))


if __name__ == "__main__":
    main()
