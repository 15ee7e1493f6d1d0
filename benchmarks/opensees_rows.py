"""Rows in OpenSeesPy and in jaxpound under one earthquake: how their displacements agree by step.

    pip install -e ".[bench]" && python benchmarks/opensees_rows.py [--record FILE] [--speed]

A row of three buildings of one storey, and a building of three storeys beside one of five; rods are
of order 1 (OpenSees: a spring beside its ``Maxwell`` material), friction is Coulomb's (OpenSees: an
``ElasticPP`` spring 10⁴ times as stiff as the first storey) and contact Kelvin and Voigt's with its
pull (``ViscoelasticGap``). Each is compared with jaxpound's run of the shortest step, in percent of
the largest displacement. Without a record the ground moves by three wavelets. ``--speed`` times a
batch of 1,024 earthquakes on the row of three against a loop over OpenSees at a like error.
"""

import argparse
import time

import jax
import numpy as np
from batches import CORES
from opensees import opensees

import jaxpound as jp

END, FRICTION = 12.0, 1e4
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
    return np.asarray(jax.vmap(ground.acceleration)(t)) / 9.80665


def peer(ops, buildings, links, samples, sample_dt, h, instants):
    """Displacements of all floors by OpenSees, shape (instants, floors), m."""
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
    stiff = FRICTION * float(buildings[0].storeys[0].stiffness)
    for link in links:
        ends = floors[link.building][link.floor], floors[link.other_building][link.other_floor]
        masses = [
            float(buildings[b].storeys[f].mass)
            for b, f in ((link.building, link.floor), (link.other_building, link.other_floor))
        ]
        effective = 1 / sum(1 / mass for mass in masses)
        dashpot = 2 * float(LAW.damping_ratio) * np.sqrt(LAW.stiffness * effective)
        slip, gap = next(tags), next(tags)
        ops.uniaxialMaterial("ElasticPP", slip, stiff, float(link.friction) / stiff)
        ops.uniaxialMaterial("ViscoelasticGap", gap, LAW.stiffness, dashpot, -float(link.gap))
        element(*ends, slip)
        element(*ends, gap)
    ops.timeSeries("Path", 1, "-dt", sample_dt, "-values", *samples, "-factor", 9.80665)
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormDispIncr", 1e-12, 100)
    ops.algorithm("KrylovNewton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    found, now = [], 0.0
    for t in instants:
        if ops.analyze(round((t - now) / h), h):
            raise RuntimeError(f"OpenSees: no convergence at h = {h}")
        now = t
        found.append([ops.nodeDisp(n, 1) for nodes in floors for n in nodes])
    return np.array(found)


def agreement(ops, record):
    """A table of differences by step, for each row."""
    instants = np.round(np.linspace(0.5, END, 24), 6)
    for name, (buildings, links) in rows().items():
        runs = {}
        for h in (0.004, 0.002, 0.001, 0.00025):
            found = jp.simulate_row(buildings, links, record, dt=h, duration=END)
            at = np.round(instants / float(found.time[1])).astype(int)
            runs[h] = np.stack([np.asarray(mass.x)[at] for mass in found.masses], -1)
        *coarse, finest = runs
        size = np.abs(runs[finest]).max()
        impacts = [int(link.n_impacts) for link in found.demand.links]
        print(f"{name}: largest displacement {size:.4f} m, impacts of the links {impacts}")
        for h in coarse:
            print(
                f"  jaxpound h = {h:<8} {100 * np.abs(runs[h] - runs[finest]).max() / size:.3f} %"
            )
        for h in (0.002, 0.001, 0.0005, 0.0002, 0.0001):
            x = peer(ops, buildings, links, record.samples.tolist(), float(record.dt), h, instants)
            share = 100 * np.abs(x - runs[finest]).max() / size
            print(f"  OpenSees h = {h:<8} {share:.3f} %")


def speed(ops, record, runs=1024, looped=3, dt=0.004, h=0.0005):
    """Times of a run on one core: a batch of scaled records, and OpenSees' loop."""
    buildings, links = rows()["three of one storey"]
    row, scales = jp.dimensionless_row(buildings, links)
    grid = scales.grid(END, dt)
    shaking = scales.to_dimensionless(record)
    factors = np.linspace(0.5, 1.5, runs)

    def gaps(factor):
        ground = jp.Record(shaking.samples * factor, shaking.dt, time_unit=shaking.time_unit)
        return jp.demand(row, ground, grid).min_gap

    many = jax.jit(jax.vmap(gaps))
    jax.block_until_ready(many(factors))
    start = time.perf_counter()
    jax.block_until_ready(many(factors))
    ours = (time.perf_counter() - start) * CORES / runs
    start = time.perf_counter()
    for factor in factors[:looped]:
        samples = (np.asarray(record.samples) * factor).tolist()
        peer(ops, buildings, links, samples, float(record.dt), h, [END])
    theirs = (time.perf_counter() - start) / looped
    print(
        f"batch of {runs:,} on the row of three, dt = {dt} s: {1e3 * ours:.2f} ms of a core a run"
    )
    print(f"OpenSees' loop, h = {h} s: {1e3 * theirs:.1f} ms a run, {theirs / ours:.0f} times")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--record", help="an accelerogram in g")
    parser.add_argument("--speed", action="store_true")
    args = parser.parse_args()
    motion = jp.read_record(args.record) if args.record else jp.Record(wavelets(0.005), 0.005)
    (speed if args.speed else agreement)(opensees(), motion)
