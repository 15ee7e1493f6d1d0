"""Rows in OpenSeesPy and in jaxpound under one earthquake: how their displacements agree by step.

    pip install -e ".[bench]" && python benchmarks/opensees_rows.py [--record FILE] [--speed]

A row of three buildings of one storey, and a building of three storeys beside one of five; rods are
of order 1 (OpenSees: a spring beside its ``Maxwell`` material), contact is Kelvin and Voigt's with
its pull (``ViscoelasticGap``) and friction Coulomb's (an ``ElasticPP`` spring; its stiffness, in
those of the first storey, is in the table). Differences are from jaxpound's run of the shortest
step, the largest of all floors and of 24 instants, in percent of the largest displacement; "fails"
is where Newton's iteration does not converge. Without a record the ground moves by three wavelets.
``--speed`` times a batch of 1,024 earthquakes on the row of three and a loop over OpenSees, at like
differences under El Centro.

Where the damper stops, OpenSees' spring keeps vibrating, undamped, at a speed that falls with the
root of its stiffness; with that root falls the difference that shorter steps leave.
"""

import argparse
import time
from dataclasses import replace

import jax
import numpy as np
from opensees import opensees

import jaxpound as jp

jax.config.update("jax_enable_x64", True)
jp.runtime.use_cores()

END = 12.0
INSTANTS = np.round(np.linspace(0.5, END, 24), 6)
STEPS = (0.004, 0.002, 0.001, 0.0005, 0.0002, 0.0001, 5e-5, 2e-5, 1e-5)
OURS, FINEST = STEPS[:3], 0.00025
PEERS = [
    (rule, stiffness, steps)
    for rule, steps, springs in (
        ("explicit", STEPS[1:], (1e3, 1e4, 1e5, 1e6)),
        ("Newmark", STEPS[1:7], (1e3, 1e5)),
    )
    for stiffness in springs
]
LIKE = (0.004, 1e5, 0.0002), (0.002, 1e6, 5e-5)  # jaxpound's step; OpenSees' spring and step
LAW = jp.KelvinVoigt(stiffness=2e8, restitution=0.65, tension=True)


def one(mass, period, damping):
    """A building of one storey on a Zener rod of order 1."""
    return jp.ShearBuilding.from_period(1, mass, period, damping, order=1.0, tau_f=0.01)


def rows():
    """The two rows in SI units, by name: buildings and links."""
    houses = one(300e3, 0.5, 0.05), one(200e3, 0.35, 0.05), one(400e3, 0.7, 0.05)
    low, high = (
        jp.ShearBuilding.from_period(n, 250e3, period, 0.05, order=1.0, tau_f=0.005, taper=0.7)
        for n, period in ((3, 0.35), (5, 0.7))
    )
    between = {"friction": 60e3, "gap": 0.02, "contact": LAW}
    return {
        "three of one storey": (houses, jp.floor_links(houses, **between)),
        "3 beside 5 storeys": ((low, high), jp.floor_links((low, high), **between)),
    }


def wavelets(dt):
    """A record, in g, of three wavelets, at steps of dt seconds."""
    t = dt * np.arange(round(END / dt) + 1)
    ground = jp.Ricker([0.02, -0.03, 0.02], [0.4, 0.6, 0.9], [2.0, 3.5, 5.0])
    return np.asarray(jax.vmap(ground.acceleration)(t)) / jp.STANDARD_GRAVITY


def assemble(ops, buildings, links, record, stiffness):
    """The row in OpenSees under a record, without friction for stiffness 0; its floors' nodes."""
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.node(1, 0.0)
    ops.fix(1, 1)
    tags, floors, node = iter(range(1, 10_000)), [], 2

    def element(i, j, material):
        ops.element("zeroLength", next(tags), i, j, "-mat", material, "-dir", 1)

    for building in buildings:
        below, nodes = 1, []
        for storey in building.storeys:
            ops.node(node, 0.0)
            ops.mass(node, float(storey.mass))
            k, tau_f, tau_x = (float(x) for x in (storey.stiffness, storey.tau_f, storey.tau_x))
            spring, maxwell, rod = (next(tags) for _ in range(3))
            ops.uniaxialMaterial("Elastic", spring, k)
            ops.uniaxialMaterial(
                "Maxwell", maxwell, k * (tau_x / tau_f - 1), k * (tau_x - tau_f), 1.0, 1.0
            )
            ops.uniaxialMaterial("Parallel", rod, spring, maxwell)
            element(below, node, rod)
            nodes.append(node)
            below, node = node, node + 1
        floors.append(nodes)
    stiff = stiffness * float(buildings[0].storeys[0].stiffness)
    for link in links:
        ends = floors[link.building][link.floor], floors[link.other_building][link.other_floor]
        effective = 1 / sum(1 / ops.nodeMass(end, 1) for end in ends)
        dashpot = 2 * float(LAW.damping_ratio) * np.sqrt(LAW.stiffness * effective)
        slip, gap = next(tags), next(tags)
        ops.uniaxialMaterial("ViscoelasticGap", gap, LAW.stiffness, dashpot, -float(link.gap))
        element(*ends, gap)
        if stiffness:
            ops.uniaxialMaterial("ElasticPP", slip, stiff, float(link.friction) / stiff)
            element(*ends, slip)
    samples = np.asarray(record.samples).tolist()
    ops.timeSeries(
        "Path", 1, "-dt", float(record.dt), "-values", *samples, "-factor", jp.STANDARD_GRAVITY
    )
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    return [node for nodes in floors for node in nodes]


def peer(ops, row, record, rule, stiffness, h, instants=INSTANTS):
    """Displacements of all floors by OpenSees, shape (instants, floors), m; None if it gives up."""
    nodes = assemble(ops, *row, record, stiffness)
    ops.constraints("Plain")
    ops.numberer("Plain")
    if rule == "explicit":
        ops.system("Diagonal")
        ops.algorithm("Linear")
        ops.integrator("ExplicitDifference")
    else:
        ops.system("BandGeneral")
        ops.test("NormDispIncr", 1e-12, 100)
        ops.algorithm("KrylovNewton")
        ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    found, done = [], 0
    for step in np.round(np.asarray(instants) / h).astype(int).tolist():
        if ops.analyze(step - done, h):
            return None
        done = step
        found.append([ops.nodeDisp(node, 1) for node in nodes])
    return np.array(found)


def ours(row, record, h):
    """The same by jaxpound, and the links' numbers of impacts."""
    found = jp.simulate(jp.Buildings(*row), record, dt=h, duration=END)
    at = np.round(INSTANTS / float(found.time[1])).astype(int)
    x = np.stack([np.asarray(mass.x)[at] for mass in found.masses], -1)
    return x, [int(link.n_impacts) for link in found.demand.links]


def table(ops, row, record, peers):
    """Differences by step."""
    finest, impacts = ours(row, record, FINEST)
    size = np.abs(finest).max()

    def line(what, runs):
        cells = dict.fromkeys(STEPS, "")
        for h, x in runs:
            cells[h] = "fails" if x is None else f"{100 * np.abs(x - finest).max() / size:.3f}"
        print(f"  {what:26}" + "".join(f"{cell:>8}" for cell in cells.values()), flush=True)

    print(f"  largest displacement {size:.4f} m, impacts of the links {impacts}")
    print(f"  {'h, ms':26}" + "".join(f"{1e3 * h:>8g}" for h in STEPS))
    line("jaxpound", ((h, ours(row, record, h)[0]) for h in OURS))
    for rule, stiffness, steps in peers:
        runs = ((h, peer(ops, row, record, rule, stiffness, h)) for h in steps)
        line(f"OpenSees, {rule}" + (f", {stiffness:.0e}" if stiffness else ""), runs)


def agreement(ops, record):
    """A table for each row, with and without friction."""
    for name, (buildings, links) in rows().items():
        print(name)
        table(ops, (buildings, links), record, PEERS)
        print(f"{name}, without friction")
        links = [replace(link, friction=0.0) for link in links]
        table(ops, (buildings, links), record, [("explicit", 0.0, STEPS[1:])])


def processor_time(function, *args):
    """What a call takes of all cores, s."""
    start = time.process_time()
    jax.block_until_ready(function(*args))
    return time.process_time() - start


def speed(ops, record, runs=1024, looped=5):
    """Processor time of a run: a batch of scaled records, and OpenSees' loop over a few of them."""
    row = rows()["three of one storey"]
    system, scales = jp.Buildings(*row).dimensionless()
    shaking = scales.to_dimensionless(record)
    factors = np.linspace(0.5, 1.5, runs)
    for dt, stiffness, h in LIKE:
        grid = scales.grid(END, dt)

        def gaps(factor, grid=grid):
            ground = jp.Record(shaking.samples * factor, shaking.dt, time_unit=shaking.time_unit)
            return jp.demand(system, ground, grid).min_gap

        many = jax.jit(jax.vmap(gaps))
        jax.block_until_ready(many(factors))
        here = min(processor_time(many, factors) for _ in range(3)) / runs
        loop = []
        for factor in np.linspace(0.5, 1.5, looped):
            scaled = jp.Record(np.asarray(record.samples) * factor, record.dt)
            loop.append(processor_time(peer, ops, row, scaled, "explicit", stiffness, h, [END]))
        there = np.mean(loop)
        print(f"a batch of {runs:,} on the row of three, h = {dt} s: {1e3 * here:.2f} ms a run")
        print(f"  OpenSees' loop, explicit, {stiffness:.0e}, h = {h} s: {1e3 * there:.0f} ms a run")
        print(f"  {there / here:.0f} times as long")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--record", help="an accelerogram in g")
    parser.add_argument("--speed", action="store_true")
    args = parser.parse_args()
    motion = jp.read_record(args.record) if args.record else jp.Record(wavelets(0.005), 0.005)
    (speed if args.speed else agreement)(opensees(), motion)
