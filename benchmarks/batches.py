"""Time batches of random Ricker earthquakes: throughput, gradients, memory, float32, contact.

    pip install -e ".[bench]" && python benchmarks/batches.py [SECTION ...]

Every ratio is taken within this one process, best of several rounds in turn; times themselves say
more about the machine and its other users than about jaxpound. Where JAX has a GPU the batch runs
there, without the peers, which are for CPUs.
"""

import argparse
import subprocess
import sys
import time
from dataclasses import replace

import jax
import jax.numpy as jnp
import numba
import numpy as np
from jax.extend.core import jaxprs_in_params
from peers import modal_loop, paper_algorithm, paper_batch

import jaxpound as jp
from jaxpound.simulation.rods.zener import Zener
from jaxpound.simulation.time.history import BLOCK

jax.config.update("jax_enable_x64", True)
CORES = jp.runtime.use_cores()
GPU = jax.default_backend() == "gpu"

CASE = jp.paper.structures()
GRID = jp.TimeGrid.until(20.0, 0.04)  # min gap of the paper's case within 5.2e-4
PAPER_GRID = jp.TimeGrid.until(20.0, 0.002)  # the paper's algorithm: within 6.4e-4
RUNS = 65_536 if GPU else 480 * CORES
KELVIN = jp.KelvinVoigt(stiffness=1000.0, restitution=0.65)
PAPER, RODS = "paper's algorithm in Numba", ("order", "tau_f", "tau_x")

MANY = """
import re, sys, time
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import jaxpound as jp
jp.runtime.use_cores()
sys.path.insert(0, {folder!r})
import batches
n = int(sys.argv[1])
start = time.perf_counter()
gaps = jp.runtime.in_chunks(lambda i: batches.drawn(i, **{changes}).min_gap)(np.arange(n))
seconds = time.perf_counter() - start
peak = int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1]) / 2**20
print(seconds, peak, (gaps <= {at_most}).mean())
"""


def earthquake(key):
    """Amplitude, periods and arrivals of five wavelets, and the damper's friction."""
    amplitude, friction, *shape = jax.random.uniform(key, 12)
    periods = jnp.array([1.25, 1.0, 2.0, 3.5, 3.8]) * (0.8 + 0.4 * jnp.array(shape[:5]))
    arrivals = jnp.arange(1.5, 6.5) + 0.6 * (jnp.array(shape[5:]) - 0.5)
    return 0.1 + 0.9 * amplitude, periods, arrivals, 0.1 + 0.3 * friction


def demand(amplitude, periods, arrivals, friction, grid=GRID, **changes):
    ground = jp.Ricker(amplitude, periods, arrivals)
    return jp.demand(replace(CASE, friction=friction, **changes), ground, grid)


def drawn(index, **changes):
    """The earthquake of a number, whatever the batch it runs in."""
    return demand(*earthquake(jax.random.fold_in(jax.random.key(0), index)), **changes)


def structures_of(design):
    """The paper's case with friction and the four relaxation times of a design."""
    friction, tau_f1, tau_x1, tau_f2, tau_x2 = design
    return replace(
        CASE,
        friction=friction,
        rod_1=replace(CASE.rod_1, tau_f=tau_f1, tau_x=tau_x1),
        rod_2=replace(CASE.rod_2, tau_f=tau_f2, tau_x=tau_x2),
    )


def designed(design, amplitude, periods, arrivals):
    """Min gap by friction and the four relaxation times."""
    ground = jp.Ricker(amplitude, periods, arrivals)
    return jp.demand(structures_of(design), ground, GRID).min_gap


def impulse(design, amplitude, periods, arrivals):
    """Impulse of the strongest impact, by friction, the four relaxation times and the gap."""
    structures = replace(structures_of(design[:5]), initial_gap=design[5], contact=KELVIN)
    return jp.demand(structures, jp.Ricker(amplitude, periods, arrivals), GRID).peak_impulse


DESIGN = jnp.array(
    [CASE.friction, CASE.rod_1.tau_f, CASE.rod_1.tau_x, CASE.rod_2.tau_f, CASE.rod_2.tau_x]
)


def best(calls, rounds=7):
    """Shortest time of each call, all in turn, so that a busy moment meets them alike.

    An untimed call comes before each: threads of the call before may still wait on the cores, as
    those of Numba do, and its numbers fill the caches.
    """
    for call in calls.values():
        call()
    times = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            start = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - start)
    return {name: min(seconds) for name, seconds in times.items()}


def ready(function, *args):
    return lambda: jax.block_until_ready(function(*args))


def peer_rods():
    """Both rods' coefficients, as ``modal_loop`` wants them."""
    history = jp.ModalHistory()
    rows = []
    for rod, modulus in ((CASE.rod_1, 1.0), (CASE.rod_2, CASE.stiffness_ratio)):
        rod = jax.tree.map(jnp.asarray, rod)
        law = Zener.of(rod, modulus, GRID.dt, 2)
        first = [law.stiffness, law.lag, law.memory]
        scaled = [float(x / law.divisor) for x in first]
        parts = history.kernel(rod.order, GRID.n_steps)
        decay = np.concatenate([part.ahead[:, 1] for part in parts])
        weight = np.concatenate([part.weight for part in parts])
        own = [modulus, float(rod.tau_f), float(rod.tau_x)]
        rows.append([*scaled, *own, *jp.simulation.gl_weights(rod.order, 4)[1:], *decay, *weight])
    return np.array(rows)


def throughput(batch):
    whole, gap = jax.jit(jax.vmap(demand)), jax.jit(jax.vmap(lambda *x: demand(*x).min_gap))
    calls = {"demand, every scalar": ready(whole, *batch), "its min gap alone": ready(gap, *batch)}
    if not GPU:
        amplitude, periods, arrivals, friction = (np.asarray(x) for x in batch)
        peer = (amplitude, periods.T.copy(), arrivals.T.copy(), friction, peer_rods())
        peer = (*peer, float(CASE.mass_ratio), GRID.dt, GRID.n_steps)
        calls["modal loop in Numba, min gap alone"] = lambda: modal_loop(*peer)
        alike = np.abs(modal_loop(*peer) + CASE.initial_gap - gap(*batch)).max()
        ground = jp.paper.ground()
        paper = (
            *(np.array([getattr(r, k) for r in (CASE.rod_1, CASE.rod_2)]) for k in RODS),
            np.array([1.0, CASE.stiffness_ratio]),
            CASE.mass_ratio,
            CASE.friction,
            np.asarray(ground.acceleration(PAPER_GRID.times())),
            PAPER_GRID.dt,
        )
        calls[PAPER] = lambda: paper_batch(2 * CORES, *paper)
    times = best(calls)
    runs = dict.fromkeys(times, RUNS) | {PAPER: 2 * CORES}
    each = {name: seconds / runs[name] for name, seconds in times.items()}
    print(f"\nA batch of {RUNS:,} runs of {GRID.n_steps} steps, float64")
    for name, seconds in each.items():
        steps = PAPER_GRID.n_steps if "paper" in name else GRID.n_steps
        print(f"  {name:36} {1e6 * seconds:10.1f} µs a run {1e6 * seconds / steps:8.4f} a step")
    ours = each["demand, every scalar"]
    if not GPU:
        loop = each["modal loop in Numba, min gap alone"]
        print(f"  as fast as the modal loop: {loop / ours:.2f} times with every scalar,")
        print(f"    {loop / each['its min gap alone']:.2f} times min gap against min gap")
        print(f"    (their min gaps differ by at most {alike:.0e})")
        smallest = jp.paper.reference().min_gap_change
        error = float(jp.demand(CASE, ground, GRID).min_gap) - CASE.initial_gap - smallest
        paper_error = paper_algorithm(*paper) - smallest
        print(f"  against the paper's algorithm: {each[PAPER] / ours:,.0f} times, with errors of")
        print(f"    {error:.1e} (h = {GRID.dt}) and {paper_error:.1e} (h = {PAPER_GRID.dt})")
    limits(ours)


def limits(seconds):
    """What share of the machine's arithmetic and memory traffic a batch uses."""
    one = earthquake(jax.random.key(0))
    jaxpr = jax.make_jaxpr(demand)(*one).jaxpr
    operations = count(jaxpr)
    scans = [e for e in equations(jaxpr) if e.primitive.name == "scan"]
    state = max(sum(v.aval.size for v in e.outvars[: e.params.get("num_carry")]) for e in scans)
    n = 4096 if GPU else 2048
    square, long = jnp.ones((n, n)), jnp.ones(2**26)
    flat = np.ones((n, n))
    multiply = ready(jax.jit(jnp.matmul), square, square) if GPU else lambda: flat @ flat
    times = best({"product": multiply, "copy": ready(jax.jit(jnp.negative), long)})
    peak, bandwidth = 2 * n**3 / times["product"], 2 * long.nbytes / times["copy"]
    rate, traffic = operations / seconds, 2 * 8 * state / BLOCK * GRID.n_steps / seconds
    print(f"  {operations / GRID.n_steps:.0f} floating-point operations a step (each of + − × ÷")
    print(f"    max exp √ … one), {rate / 1e9:.1f} G/s: {rate / peak:.0%} of the machine's peak")
    print(f"    ({peak / 1e9:.0f} G/s, the product of two matrices)")
    if GPU:  # a CPU keeps the state in its caches
        print(f"  {2 * 8 * state / BLOCK:.0f} bytes of state a step, {traffic / 1e9:.0f} GB/s:")
        print(f"    {traffic / bandwidth:.0%} of a copy in memory ({bandwidth / 1e9:.0f} GB/s)")


ARITHMETIC = {"add", "sub", "mul", "div", "neg", "abs", "max", "min", "exp", "sqrt", "sign"}
ARITHMETIC |= {"integer_pow", "square", "pow", "log", "tanh"}


def equations(jaxpr):
    for equation in jaxpr.eqns:
        yield equation
        for inner in jaxprs_in_params(equation.params):
            yield from equations(inner)


def count(jaxpr):
    """Floating-point operations of a program, loops included."""
    total = 0
    for equation in jaxpr.eqns:
        shape = equation.outvars[0].aval if equation.outvars else None
        if equation.primitive.name in ARITHMETIC and np.issubdtype(shape.dtype, np.floating):
            total += shape.size
        elif equation.primitive.name == "dot_general":
            (contracted, _), _ = equation.params["dimension_numbers"]
            depth = np.prod([equation.invars[0].aval.shape[axis] for axis in contracted])
            total += int(2 * shape.size * depth)
        inner = sum(count(inner) for inner in own_jaxprs(equation))
        total += inner * equation.params.get("length", 1)
    return total


def own_jaxprs(equation):
    # A custom derivative rule carries other programs too; only the function itself runs.
    call = equation.params.get("call_jaxpr", equation.params.get("call"))
    if equation.primitive.name.startswith("custom") and call is not None:
        return [getattr(call, "jaxpr", call)]
    return list(jaxprs_in_params(equation.params))


def gradients(batch):
    amplitude, periods, arrivals, _ = batch
    each = (None, 0, 0, 0)
    functions = {
        "value": jax.vmap(designed, each),
        "value and gradient of each run": jax.vmap(jax.value_and_grad(designed), each),
        "value and gradient of the mean": jax.value_and_grad(
            lambda *x: jax.vmap(designed, each)(*x).mean()
        ),
        "forward mode, each run": jax.vmap(jax.jacfwd(designed), each),
    }
    args = (DESIGN, amplitude, periods, arrivals)
    compiled, effort = {}, {}
    for name, function in functions.items():
        compiled[name], effort[name] = built(function, *args)
    times = best({name: ready(f, *args) for name, f in compiled.items()})
    print(f"\nMin gap and its derivatives by μ and four τ, {RUNS:,} runs")
    for name, t in times.items():
        print(f"  {name:32} {t / times['value']:5.1f} times the value; {effort[name]}")
    print(f"  {'every scalar, no derivative':32} {built(jax.vmap(demand), *batch)[1]:>29}")


def built(function, *args):
    """The compiled function, and how long that took."""
    start = time.perf_counter()
    lowered = jax.jit(function).lower(*args)
    middle = time.perf_counter()
    compiled = lowered.compile()
    end = time.perf_counter()
    return compiled, f"traced in {middle - start:.1f} s, compiled in {end - middle:.1f} s"


def records():
    """Records: a batch beside one of wavelets, and the gradient by all samples."""
    samples = 0.3 * np.random.default_rng(0).normal(size=GRID.n_steps) * np.hanning(GRID.n_steps)
    factors = np.linspace(0.5, 1.5, RUNS)

    def gap(samples, factor):
        record = jp.Record(samples, GRID.dt, time_unit="1/ω1")
        return jp.demand(CASE, factor * record, GRID).min_gap

    own = samples * factors[:, None]
    wavelets = draw(RUNS)
    functions = {
        "wavelets": (jax.jit(jax.vmap(lambda *x: demand(*x).min_gap)), *wavelets),
        "one record, scaled": (jax.jit(jax.vmap(gap, (None, 0))), samples, factors),
        "a record each": (jax.jit(jax.vmap(gap)), own, factors),
        "value and gradient by all samples": (
            jax.jit(jax.vmap(jax.value_and_grad(gap))),
            own,
            factors,
        ),
    }
    times = best({name: ready(*call) for name, call in functions.items()})
    print(f"\nRecords of {GRID.n_steps} samples: {RUNS} runs, min gap alone")
    for name, seconds in times.items():
        print(f"  {name:36}{seconds / times['wavelets']:6.2f} times the wavelets")


def widths():
    print("\nfloat32 against float64: speed and min gap's error by rounding")
    for h in (0.04, 0.02, 0.01):
        grid = jp.TimeGrid.until(20.0, h)
        run = jax.jit(jax.vmap(lambda *x, grid=grid: demand(*x, grid=grid)))
        double = draw(RUNS)
        single = jax.tree.map(lambda x: x.astype(jnp.float32), double)
        # The same numbers in both widths, so that rounding is all that differs.
        double = jax.tree.map(lambda x: x.astype(jnp.float64), single)
        times = best({"64": ready(run, *double), "32": ready(run, *single)}, 3)
        difference = np.abs(run(*double).min_gap - run(*single).min_gap)
        print(
            f"  h = {h}: {times['64'] / times['32']:.1f} times as fast, "
            f"off by {np.median(difference):.0e} (median), {difference.max():.0e} (most)"
        )


def checkpoints():
    print("\nReverse mode of one run: memory and time, plain and by checkpoints")
    for n in (2500, 10_000, 40_000):
        runs = {}
        for checkpoint in (False, True):
            grid, scheme = jp.TimeGrid(20 / n, n), jp.Scheme(checkpoint=checkpoint)

            def gap(structures, grid=grid, scheme=scheme):
                return jp.demand(structures, jp.paper.ground(), grid, scheme).min_gap

            runs[checkpoint] = jax.jit(jax.grad(gap)).lower(CASE).compile()
        times = best({checkpoint: ready(run, CASE) for checkpoint, run in runs.items()}, 3)
        memory = [run.memory_analysis().temp_size_in_bytes / 2**20 for run in runs.values()]
        print(
            f"  {n:6,} steps {memory[0]:8.2f} and {memory[1]:5.2f} MiB,"
            f" {1e3 * times[False]:6.0f} and {1e3 * times[True]:4.0f} ms"
        )


def many(sizes=(100_000, 1_000_000), changes="{}", at_most=-0.7):
    """Batches of a process each; the keyword arguments of ``drawn`` as Python text."""
    print("\nMany earthquakes in one process, in_chunks, drawn by number")
    program = MANY.format(folder=sys.path[0], changes=changes, at_most=at_most)
    for n in sizes:
        command = [sys.executable, "-c", program, str(n)]
        output = subprocess.run(command, capture_output=True, check=True, text=True).stdout
        seconds, peak, share = map(float, output.split())
        told = f"{seconds:6.1f} s, peak resident {peak:.2f} GiB"
        print(f"  {n:9,}: {told}, P(gap ≤ {at_most}) {share:.4f}")


def contact(batch):
    """Kelvin's contact in the batch, at a gap that 10 % close and at one that all close."""
    free, each = jax.jit(jax.vmap(demand)), (0, 0, 0, 0, None)
    touching = jax.vmap(lambda *x: demand(*x[:4], initial_gap=x[4], contact=KELVIN), each)
    touching, effort = built(touching, *batch, 1.0)
    required = CASE.initial_gap - np.asarray(free(*batch).min_gap)
    gaps = {"10 % pound": np.quantile(required, 0.9), "all pound": 0.999 * required.min()}
    gaps = {name: float(gap) for name, gap in gaps.items()}
    calls = {name: ready(touching, *batch, gap) for name, gap in gaps.items()}
    times = best({"none": ready(free, *batch)} | calls)
    print(f"\nKelvin contact, k = 1,000, {RUNS:,} runs, every scalar; {effort}")
    for name, gap in gaps.items():
        found = touching(*batch, gap)
        assert np.isfinite(found.min_gap).all()
        impacts, ratio = np.mean(found.n_impacts), times[name] / times["none"]
        told = f"{np.mean(found.pounds):4.0%} pound, {impacts:.2f} impacts a run"
        print(f"  gap {gap:6.4f}: {told}, {ratio:5.2f} times the batch without contact")

    waves, each = batch[:3], (None, 0, 0, 0)
    functions = {
        "value": lambda *x: jax.vmap(impulse, each)(*x).mean(),
        "value and gradient of the mean": jax.value_and_grad(
            lambda *x: jax.vmap(impulse, each)(*x).mean()
        ),
        "forward mode, each run": jax.vmap(jax.jacfwd(impulse), each),
    }
    designs = {name: jnp.append(DESIGN, gap) for name, gap in gaps.items()}
    calls, effort = {}, {}
    for name, function in functions.items():
        compiled, effort[name] = built(function, designs["all pound"], *waves)
        for gap, design in designs.items():
            calls[name, gap] = ready(compiled, design, *waves)
    times = best(calls, 3)
    print(f"Impulse of the strongest impact by μ, four τ and gap, {RUNS:,} runs")
    for name, told in effort.items():
        ratios = (f"{times[name, gap] / times['value', gap]:5.1f} ({gap})" for gap in gaps)
        print(f"  {name:32}{''.join(ratios)} times the value; {told}")
    changes = f"dict(initial_gap={gaps['10 % pound']}, contact=batches.KELVIN)"
    many((20_000, 100_000), changes, at_most=0.0)


def draw(n):
    return jax.vmap(earthquake)(jax.random.split(jax.random.key(1), n))


def main():
    numba.set_num_threads(CORES)
    batch = draw(RUNS)
    sections = {
        "throughput": lambda: throughput(batch),
        "gradients": lambda: gradients(batch),
        "records": records,
        "widths": widths,
        "checkpoints": checkpoints,
        "many": many,
        "contact": lambda: contact(batch),
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("section", nargs="*", help=f"{', '.join(sections)}; by default all")
    chosen = parser.parse_args().section or [*sections]
    print(f"JAX {jax.__version__}, {jax.devices()[0].device_kind}, {CORES} cores")
    for name in chosen:
        sections[name]()


if __name__ == "__main__":
    main()
