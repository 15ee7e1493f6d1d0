"""A loop over OpenSeesPy's ViscoelasticGap pairs beside jaxpound's batch, at equal accuracy.

    pip install -e ".[bench]" && python benchmarks/opensees.py

OpenSees has no fractional rod: the buildings are elastic, without damper, and collide by Kelvin and
Voigt's law whose force may pull, as ``ViscoelasticGap`` has it. Errors are of both displacements
over twenty instants, against SciPy's integration from event to event. OpenSees runs on one core;
jaxpound's batch is charged for all the cores it takes.
"""

import os
import sys
from dataclasses import replace

import jax
import numpy as np
from batches import CASE, CORES, best, draw, ready
from opensees_library import load_blas
from scipy.integrate import solve_ivp

import jaxpound as jp

END, GAP, RUNS, LOOPED = 20.0, 0.5, 512 * CORES, 12
INSTANTS = np.linspace(1.0, END, 20)
LAW = jp.KelvinVoigt(stiffness=1000.0, restitution=0.65, tension=True)
PAIR = replace(
    CASE,
    rod_1=jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1),
    rod_2=jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1),
    friction=0.0,
    initial_gap=GAP,
    contact=LAW,
)
RHO, MODULUS = float(PAIR.mass_ratio), float(PAIR.stiffness_ratio)
DASHPOT = 2 * float(LAW.damping_ratio) * np.sqrt(LAW.stiffness / (1 + RHO))
STEPS = {
    "jaxpound": (0.04, 0.02, 0.01),
    "OpenSees": (0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001),
}


def opensees():
    """The module."""
    load_blas()
    try:
        import openseespy.opensees as ops
    except (ImportError, RuntimeError) as error:
        sys.exit(f"OpenSeesPy cannot be imported ({error}); see benchmarks/README.md")
    ops.logFile(os.devnull, "-noEcho")  # it would report every impact
    return ops


def peer(ops, acceleration, h):
    """Displacements of one pair at the instants, shape (20, 2); ground acceleration by step."""
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    for node in range(1, 5):
        ops.node(node, 0.0)
    ops.fix(1, 1)
    ops.fix(4, 1)
    ops.mass(2, 1.0)
    ops.mass(3, 1 / RHO)
    ops.uniaxialMaterial("Elastic", 1, 1.0)
    ops.uniaxialMaterial("Elastic", 2, MODULUS)
    ops.uniaxialMaterial("ViscoelasticGap", 3, LAW.stiffness, DASHPOT, -GAP)
    for element, ends in enumerate(((1, 2), (4, 3), (2, 3)), start=1):
        ops.element("zeroLength", element, *ends, "-mat", element, "-dir", 1)
    ops.timeSeries("Path", 1, "-dt", h, "-values", *acceleration)
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    # Explicit: Newton's iteration for Newmark's rule fails at some touches, takes twice the time
    # and is no closer: the error is that of the instants at which contact begins and ends.
    ops.algorithm("Linear")
    ops.integrator("ExplicitDifference")
    ops.analysis("Transient")
    found = []
    for _ in INSTANTS:
        if ops.analyze(round(END / INSTANTS.size / h), h):
            raise RuntimeError(f"OpenSees: no convergence at h = {h}")
        found.append([ops.nodeDisp(2, 1), ops.nodeDisp(3, 1)])
    return np.array(found)


def reference(ground):
    """The same displacements from impact to impact."""

    def motion(touching):
        def slope(t, y):
            x1, x2, v1, v2 = y
            contact = touching * (LAW.stiffness * (x1 - x2 - GAP) + DASHPOT * (v1 - v2))
            shaking = float(ground(t))
            return [v1, v2, -x1 - contact - shaking, RHO * (contact - MODULUS * x2) - shaking]

        return slope

    def closed(t, y):
        return y[0] - y[1] - GAP

    closed.terminal = True
    t, y, touching, found = 0.0, np.zeros(4), False, []
    while t < END:
        closed.direction = -1 if touching else 1
        run = solve_ivp(
            motion(touching),
            (t, END),
            y,
            "DOP853",
            dense_output=True,
            events=closed,
            max_step=0.01 if touching else np.inf,  # several in a contact
            rtol=1e-11,
            atol=1e-13,
        )
        found += [run.sol(x)[:2] for x in INSTANTS if t < x <= run.t[-1]]
        t, y, touching = run.t[-1], run.y[:, -1], not touching
    return np.array(found)


def main():
    ops = opensees()
    batch = draw(RUNS)[:3]
    waves = [jp.Ricker(*(np.asarray(x[i]) for x in batch)) for i in range(LOOPED)]
    truths = np.array([reference(jax.jit(wave.acceleration)) for wave in waves])
    table = {name: [] for name in STEPS}
    print(f"A pair of elastic buildings, gap {GAP}, Kelvin contact, k = {LAW.stiffness:,.0f}")

    for h in STEPS["jaxpound"]:
        grid = jp.TimeGrid.until(END, h)
        run = jax.jit(jax.vmap(lambda *x, grid=grid: jp.demand(PAIR, jp.Ricker(*x), grid)))
        path = jax.vmap(lambda *x, grid=grid: jp.simulate(PAIR, jp.Ricker(*x), grid))
        found = path(*(x[:LOOPED] for x in batch))
        every = [round(t / h) for t in INSTANTS]
        moved = np.stack([found.x1[:, every], found.x2[:, every]], axis=-1)
        seconds = best({"run": ready(run, *batch)}, 3)["run"] * CORES / RUNS
        table["jaxpound"].append((h, np.abs(moved - truths).max(axis=(1, 2)), seconds))
    impacts = np.mean(run(*batch).n_impacts)
    print(f"  {impacts:.1f} impacts a run; errors: median of {LOOPED} earthquakes, of the worst")

    for h in STEPS["OpenSees"]:
        times = h * np.arange(round(END / h) + 1)
        shakings = [np.asarray(wave.acceleration(times)).tolist() for wave in waves]

        def loop(h=h, shakings=shakings):
            return [peer(ops, acceleration, h) for acceleration in shakings]

        errors = np.abs(np.array(loop()) - truths).max(axis=(1, 2))
        table["OpenSees"].append((h, errors, best({"loop": loop}, 3)["loop"] / LOOPED))

    for name, rows in table.items():
        for h, errors, seconds in rows:
            told = f"{np.median(errors):.1e}, {errors.max():.1e}"
            print(f"  {name:9} h = {h:<7}{told}, {1e6 * seconds:10,.0f} µs of a core a run")
    theirs = [np.log([np.median(row[1]), row[2]]) for row in table["OpenSees"]]
    errors, costs = np.array(theirs)[::-1].T
    for h, error, seconds in table["jaxpound"]:
        wanted = np.log(np.median(error))
        if errors[0] <= wanted <= errors[-1]:
            ratio = np.exp(np.interp(wanted, errors, costs)) / seconds
            print(f"  at the error of jaxpound's h = {h}, OpenSees takes {ratio:.0f} times as long")


if __name__ == "__main__":
    main()
