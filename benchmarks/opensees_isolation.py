"""OpenSees' bearings and viscous damper beside those of jaxpound: accuracy against time.

    pip install -e ".[bench]" && python -m benchmarks.opensees_isolation

A building of one storey on friction pendulums (SingleFPBearing) and on lead–rubber bearings,
bilinear (ElastomericBearingPlasticity) or after Bouc and Wen (ElastomericBearingBoucWen), and two
buildings with a damper of a power of the velocity and its brace between them (ViscousDamper).
Errors are of the displacements at every second, over the largest of them, against SciPy's
integration from event to event of the same equations. Ratios of processor times, each the range of
three repetitions, are to jaxpound's longest step with an error at most as large as OpenSees'.
"""

import time
from dataclasses import replace

import jax
import numpy as np
from scipy.integrate import solve_ivp

import jaxpound as jp
from benchmarks import opensees_yielding as of_yielding

STEPS, EACH, END, KINIT = (0.02, 0.01, 0.005, 0.002), range(3), 16, (1e9, 1e10)
CLOCK, TOLERANCE = time.process_time, 1e-10  # of Newton's iteration, in m
GROUND = jp.Ricker(0.12, np.array([1.6, 2.4, 1.2]), np.array([3.2, 4.7, 7.2]))
ROD = {"order": 1.0, "tau_f": 0.01, "tau_x": 0.02}
BASE, FLOOR, NEIGHBOUR = 350e3, jp.Building(300e3, 4.5e7, **ROD), jp.Building(400e3, 1.6e7, **ROD)
WEIGHT = (BASE + FLOOR.mass) * jp.STANDARD_GRAVITY
PENDULUM, RUBBER = jp.FrictionPendulum(2.24, 0.06), jp.LeadRubber(2.5, 0.05)
DAMPER, BRACE = jp.PowerLaw(force=8e5, exponent=0.3), 2e8
AFTER = (2 * np.pi / RUBBER.period) ** 2 * WEIGHT / jp.STANDARD_GRAVITY
YIELD = RUBBER.strength * WEIGHT, RUBBER.yield_displacement  # force and elongation
LEAD = YIELD[0] / YIELD[1]
SMOOTH = jp.BoucWen(YIELD[1], AFTER / (AFTER + LEAD), exponent=2.0, beta=0.5)
AXES = "-P", 1, "-Mz", 1, "-orient", 0, 1, 0, -1, 0, 0

# A law is of the phase, the elongation e with its rate w, a state z, and the force that is needed
# to leave w as it is. It returns the force, the rate of z, and what is positive until the phase
# ends; after it the next phase and z there.


def pendulum(spring=np.inf):
    """The friction pendulum; that of OpenSees has a spring in stick.

    Its normal force includes a part of the shear force, by the slope of the surface.
    """
    mu, radius, tilts = PENDULUM.friction, PENDULUM.radius, spring < np.inf

    def held(e, z, need):
        if not tilts:
            force, normal = need, WEIGHT
        else:
            tilt = e / radius
            normal = (WEIGHT + tilt * spring * (e - z)) / (1 - tilt * z / radius)
            force = spring * (e - z) + normal * z / radius
        return force, force - normal * e / radius, mu * normal

    def law(phase, e, w, z, need):
        if phase:
            share = phase * mu + e / radius
            return WEIGHT * share / (1 - share * tilts * e / radius), 0.0, phase * w
        force, rest, limit = held(e, z, need)
        return force, 0.0, limit - abs(rest)

    def after(phase, e, z, need):
        if phase and tilts:
            force = law(phase, e, 0.0, z, need)[0]
            normal = force / (phase * mu + e / radius)
            return 0, e - phase * mu * normal / (spring - normal / radius)
        _, rest, limit = held(e, z, need)
        return 0 if phase and abs(rest) <= limit else np.sign(rest), z

    return law, after


def rubber():
    """The lead–rubber bearing; z is the elastic elongation of the lead."""

    def law(phase, e, w, z, need):
        rate, margin = (0.0, phase * w) if phase else (w, YIELD[1] - abs(z))
        return AFTER * e + LEAD * z, rate, margin

    return law, lambda phase, e, z, need: (0 if phase else np.sign(z), z)


def smooth():
    """The same with the law of Bouc and Wen."""

    def law(phase, e, w, z, need):
        loss = SMOOTH.beta * np.sign(z * (phase or 1)) + 1 - SMOOTH.beta
        loss *= abs(z / YIELD[1]) ** SMOOTH.exponent
        return AFTER * e + LEAD * z, w * (1 - loss), (phase or 1) * w

    return law, lambda phase, e, z, need: (-(phase or 1), z)


def damper(brace):
    """The damper; z is the elongation of its dashpot."""

    def law(phase, e, w, z, need):
        force = brace * (e - z)
        return force, np.sign(force) * abs(force / DAMPER.force) ** (1 / DAMPER.exponent), 1.0

    return law, None


def exact(law, after, on_bearing=True, tolerance=1e-11):
    """Displacements at every second, by SciPy from event to event."""
    m, k = np.array([NEIGHBOUR.mass, FLOOR.mass]), np.array([NEIGHBOUR.stiffness, FLOOR.stiffness])
    ways, across = np.eye(2), np.array([1.0, -1.0])  # elongations of storeys, and of the law
    if on_bearing:
        m[0], k[0], ways[1, 0], across[1] = BASE, 0.0, -1.0, 0.0
    branch, acceleration = ROD["tau_x"] / ROD["tau_f"] - 1, jax.jit(GROUND.acceleration)

    def at(t, y, phase):
        x, v, dashpots, z = y[:2], y[2:4], y[4:6], y[6]
        e = ways @ x
        free = -ways.T @ (k * (e + branch * (e - dashpots))) / m - float(acceleration(t))
        need = across @ free / (across**2 / m).sum()
        force, rate, margin = law(phase, across @ x, across @ v, z, need)
        rates = v, free - across * force / m, (e - dashpots) / ROD["tau_f"], [rate]
        return np.concatenate(rates), margin, need

    def ends(*now):
        return at(*now)[1]

    ends.terminal, ends.direction = True, -1
    options = {"rtol": tolerance, "atol": 1e-3 * tolerance, "max_step": 0.02, "method": "LSODA"}
    options |= {"events": ends, "dense_output": True}
    t, y, phase, x = 0.0, np.zeros(7), 0, [np.zeros(2)]
    while t < END:
        run = solve_ivp(lambda *now: at(*now)[0], (t, END), y, args=(phase,), **options)
        x += [run.sol(s)[:2] for s in range(1, END + 1) if t < s <= run.t[-1]]
        t, y = run.t[-1], run.y[:, -1]
        if run.status:
            phase, y[-1] = after(phase, across @ y[:2], y[-1], at(t, y, phase)[2])
    return {"T": END, "x": np.array(x)}


def storey(ops, ends, building):
    """OpenSees' materials of a storey, side by side."""
    rod = {"law": "zener", "K": building.stiffness, "tf": building.tau_f, "tx": building.tau_x}
    for tag, (material, *numbers) in enumerate(of_yielding.materials(rod), 10 * ends[1]):
        ops.uniaxialMaterial(material, tag, *numbers)
        ops.element("zeroLength", tag, *ends, "-mat", tag, "-dir", 1)


def bearing_model(ops, element, *numbers):
    """OpenSees' model of the building on a bearing."""
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    fixed = (1, 1, 1), (0, 0, 1), (0, 1, 1)
    for node, (mass, at) in enumerate(zip((0.0, BASE, FLOOR.mass), fixed, strict=True), 1):
        ops.node(node, 0.0, 0.0)
        ops.mass(node, mass, 0.0, 0.0)
        ops.fix(node, *at)
    ops.uniaxialMaterial("Elastic", 1, 1e12)  # vertical
    ops.frictionModel("Coulomb", 1, PENDULUM.friction)
    ops.element(element, 1, 1, 2, *numbers)
    storey(ops, (2, 3), FLOOR)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(2, 0.0, -WEIGHT, 0.0)
    ops.system("FullGeneral")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    ops.analyze(1)
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()


def damper_model(ops, material, *numbers):
    """OpenSees' model of the two buildings with a damper between them."""
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.node(1, 0.0)
    ops.fix(1, 1)
    for node, building in ((2, NEIGHBOUR), (3, FLOOR)):
        ops.node(node, 0.0)
        ops.mass(node, building.mass)
        storey(ops, (1, node), building)
    ops.uniaxialMaterial(material, 1, *numbers)
    ops.element("zeroLength", 1, 3, 2, "-mat", 1, "-dir", 1)


def theirs(ops, case, h, model, *numbers):
    """Error of OpenSees' run with the step h, and its seconds; NaN if it does not converge."""
    ops.wipe()
    model(ops, *numbers)
    algorithm = "KrylovNewton" if numbers[0] == "Viscous" else "Newton"
    try:
        return of_yielding.shaken(ops, case, GROUND, h, algorithm, TOLERANCE, CLOCK)
    except RuntimeError:
        return np.nan, np.nan


def compare(ops, title, buildings, law, model, *peers):
    """Print errors of both by step, and the ratios of their times where they are comparable."""
    case, grids = exact(*law, model is bearing_model), [jp.TimeGrid.until(END, h) for h in STEPS]
    print(f"{title}\n  {'':28}" + "".join(f"{h:>10g}" for h in STEPS))
    results = [of_yielding.at_seconds(buildings, GROUND, grid) for grid in grids]
    errors = np.array([of_yielding.error(case, x) for x in results])
    show("jaxpound", errors)
    runs = [of_yielding.programs(buildings, GROUND, grid) for grid in grids]
    ours = [[[of_yielding.least(x, CLOCK) for x in run] for run in runs] for _ in EACH]
    for name, law, *numbers in peers:
        their = exact(*law, model is bearing_model)
        rows = np.array([[theirs(ops, their, h, model, *numbers) for h in STEPS] for _ in EACH])
        show(name, rows[0, :, 0])
        print(f"    between the equations: {of_yielding.error(case, their['x']):.1e}")
        for h, row in zip(STEPS, rows.swapaxes(0, 1), strict=True):
            as_good = np.flatnonzero(errors <= row[0, 0])
            if as_good.size and numbers[0] != "Viscous":
                ratios = row[:, 1:] / np.array(ours)[:, as_good[0]] * [1, of_yielding.RUNS]
                (low, least), (high, most) = ratios.min(0), ratios.max(0)
                words = f"{low:,.0f} to {high:,.0f}, of a batch {least:,.0f} to {most:,.0f}"
                print(f"    {h:g}: {words} times as long")


def show(name, errors):
    """Print errors, and the power of the step with which they fall."""
    order = np.polyfit(*np.log([np.array(STEPS), errors])[:, np.isfinite(errors)], 1)[0]
    listed = "".join(f"{x:10.1e}" for x in errors)
    print(f"  {name:28}{listed}   order {order:.1f}", flush=True)


def main() -> None:
    """Print the tables."""
    ops = of_yielding.opensees()
    (slider, links), (bearing, _) = (jp.on_bearings(FLOOR, x, BASE) for x in (PENDULUM, RUBBER))
    bouc_wen = jp.ShearBuilding((replace(bearing.storeys[0], hysteresis=SMOOTH), FLOOR))
    link = jp.FloorLink(0, 0, damper=jp.Rod(DAMPER, BRACE))
    plastic = AFTER + LEAD, YIELD[0], AFTER / (AFTER + LEAD), 0.0, 1.0
    rates, power = (SMOOTH.exponent, SMOOTH.beta, 1 - SMOOTH.beta), (DAMPER.force, DAMPER.exponent)
    surface, end = ("singleFPBearing", 1, PENDULUM.radius), (*AXES, "-iter", 50, 1e-6)
    sliders = [(f"SingleFPBearing {k:.0e}", pendulum(k), *surface, k, *end) for k in KINIT]
    elastomer = "ElastomericBearingPlasticity", rubber(), "elastomericBearingPlasticity", *plastic
    other = "ElastomericBearingBoucWen", smooth(), "elastomericBearingBoucWen", *plastic, *rates
    braced = "ViscousDamper", damper(BRACE), "ViscousDamper", BRACE, *power
    alone = "Viscous", damper(100 * BRACE), "Viscous", *power
    for title, buildings, *others in (
        ("friction pendulum", ((slider,), links), pendulum(), bearing_model, *sliders),
        ("lead–rubber", ((bearing,),), rubber(), bearing_model, (*elastomer, *AXES)),
        ("after Bouc and Wen", ((bouc_wen,),), smooth(), bearing_model, (*other, *AXES)),
        ("damper", ((NEIGHBOUR, FLOOR), (link,)), damper(BRACE), damper_model, braced, alone),
    ):
        compare(ops, title, jp.Buildings(*buildings), *others)


if __name__ == "__main__":
    main()
