"""Links of two faces as the reference ``moat.json`` has them, run at several steps by one program.

A run at the step h is made in a unit of time in which h is the grid's step. It rests at first, and
is shaken so late that it ends as the reference does.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from tests.reference import load

CASES = load("moat")["cases"]
END, EVERY = 14.4, 1.2
STEPS = (0.04, 0.02, 0.01)
GRID = jp.TimeGrid(STEPS[0], round(END / STEPS[-1]))


def numbers_of(case):
    """Numbers of a case that are not places, in the order of its leaves."""
    leaves = jax.tree.leaves(_system(case))
    return jnp.array([x for x in leaves if isinstance(x, float)])


def with_numbers(case, numbers):
    """The case with others."""
    leaves, structure = jax.tree.flatten(_system(case))
    others = iter(numbers)
    return structure.unflatten([next(others) if isinstance(x, float) else x for x in leaves])


def changed(case, path, value):
    """The case with the number at a path, such as ``link.gap.0``, changed."""
    place, leaves = "".join(f"['{x}']" for x in path.split(".")), []
    for keys, leaf in jax.tree_util.tree_leaves_with_path(_system(case)):
        at = "".join(f"['{getattr(key, 'key', getattr(key, 'idx', ''))}']" for key in keys)
        leaves.append(value if at == place else leaf)
    return case | jax.tree.structure(_system(case)).unflatten(leaves)


def _system(case):
    return {name: case[name] for name in ("m", "rods", "link")}


def system_of(case, unit=1.0):
    """A case's system in a unit of time: forces grow with its square, and times fall."""
    force = unit**2

    def rod(x):
        if "F" in x:
            material = jp.PowerLaw(x["F"] * force, x["a"], x["v"] * unit)
        else:
            material = jp.ZenerRod(1.0, x["tf"] / unit, x["tx"] / unit)
        return jp.Rod(material, x["K"] * force, tuple(x["ends"]))

    def law(x):
        return jp.KelvinVoigt(x["k"] * force, x["e"]) if "k" in x else jp.Newton(x["e"])

    link, gain = case["link"], case["link"].get("velocity_friction")
    return jp.System(
        tuple(case["m"]),
        tuple(map(rod, case["rods"])),
        (
            jp.Link(
                tuple(link["ends"]),
                link["mu"] * force,
                tuple(link["gap"]),
                tuple(map(law, link["faces"])),
                velocity_friction=gain and jp.VelocityFriction(gain["F"] * force, gain["v"] * unit),
            ),
        ),
    )


def ground_of(case, sign=1.0):
    """Two wavelets or fewer."""
    ricker = case["ricker"]
    missing = (0, 2 - len(ricker["tp"]))
    return jp.Ricker(
        np.pad(sign * ricker["u0"] * np.ones(len(ricker["tp"])), missing),
        np.pad(np.array(ricker["tp"]), missing, constant_values=1.0),
        np.pad(np.array(ricker["ts"]), missing),
    )


def rests(unit):
    """For how long a run rests at first."""
    return GRID.duration * unit - END


def outputs(case, numbers, unit, ground):
    """What the reference has derivatives of, in its units, and the response."""
    shaken = jp.Ricker(
        ground.amplitude, ground.periods / unit, (ground.arrivals + rests(unit)) / unit
    )
    response = jp.simulate(system_of(with_numbers(case, numbers), unit), shaken, GRID)
    lost = sum(link.contact_work for link in response.demand.links) / unit**2
    return jnp.stack([lost, response.masses[0].x[-1]]), response


@functools.cache
def program(name):
    """A function of numbers, a direction of them, unit and ground, for cases of one topology."""
    case = CASES[name]

    @jax.jit
    def along(numbers, direction, unit, ground):
        """Results, their derivatives along the direction, and the response."""
        run = functools.partial(outputs, case, unit=unit, ground=ground)
        return jax.jvp(run, (numbers,), (direction,), has_aux=True)

    return along


def direction(case, path):
    """Of numbers: that of the one at a path."""
    return numbers_of(changed(case, path, np.nan)) != numbers_of(case)


@functools.cache
def runs(name, like):
    """By step: results, their derivatives by the reference's numbers and the response.

    ``like`` is the case whose program it is.
    """
    case, by_step = CASES[name], {}
    for step in STEPS:
        each = [
            program(like)(
                numbers_of(case),
                direction(case, path).astype(float),
                step / GRID.dt,
                ground_of(case),
            )
            for path in case["derivatives"]
        ]
        slopes = np.stack([slope for _, slope, _ in each])
        by_step[step] = each[0][0], slopes, jax.device_get(each[0][2])
    return by_step


def errors_of_displacements(case, response, step):
    """At the reference's instants."""
    instants = (rests(step / GRID.dt) + EVERY * np.arange(1, len(case["x"]) + 1)) / step
    x = np.stack([mass.x for mass in response.masses], -1)[np.round(instants).astype(int)]
    return np.abs(x - np.array(case["x"]))
