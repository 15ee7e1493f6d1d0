"""Pairs that may touch, run many at once: a program for each kind of law, not for each run."""

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from jaxpound.model.contact import with_mass
from tests.reference import LAWS

GRID = jp.TimeGrid(0.02, 3200)
SHAKING = jp.Ricker(0.4, [1.25, 2.0, 3.5], [2.5, 3.5, 6.0])
RESOLVED = jp.Scheme()
LANES = 16
WAVELETS = 36
FORCES = ("kelvin_clip", "hertz", "hertzdamp_exact", "jankowski")
"""Laws whose force does not pull, of which those after Hertz with a damping in proportion to the
speed differ in its factor alone: they share a program."""
DIFFERENTIATED = ("kelvin_clip", "jankowski")
"""Those of them that share a program with derivatives."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class OneOf:
    """Of some laws with a force that of the number ``which``."""

    which: Any
    laws: tuple[Any, ...]

    def for_mass(self, mass):
        return OneOf(self.which, tuple(with_mass(law, mass) for law in self.laws))

    def force(self, *state):
        forces = [law.force(*state) for law in self.laws]
        return sum(jnp.where(self.which == i, force, 0.0) for i, force in enumerate(forces))


def law(name, stiffness=1000.0, restitution=0.65, among=FORCES):
    """A law by its name in ``LAWS``; Hertz's get a stiffness that is about as hard at speed 1."""
    if name not in FORCES:
        return LAWS[name](stiffness, restitution)
    hertz = stiffness**1.25
    laws = [LAWS[x](stiffness if "kelvin" in x else hertz, restitution) for x in among]
    return OneOf(float(among.index(name)), tuple(laws))


def pair(masses, materials, stiffnesses, **link):
    rods = zip(materials, stiffnesses, (0, 1), strict=True)
    return jp.System(
        masses=masses,
        rods=tuple(jp.Rod(material, k, (i, jp.GROUND)) for material, k, i in rods),
        links=(jp.Link((0, 1), **link),),
    )


POWERS = dict.fromkeys(("stiffness", "friction", "force", "increase"), 2)
POWERS |= {"coefficient": 1, "velocity": 1, "velocities": 1, "periods": -1, "arrivals": -1}
"""Of the unit of time in numbers by their names; others have none, but for relaxation times."""


def in_unit_of_time(unit, *parts):
    """Systems, grounds or states in another unit of time: a step of the grid is so often as long.

    Runs with shorter steps so need no program of their own. Forces are in units of mass times
    length over time squared, relaxation times to the power of the order in those of time.
    """

    def in_unit(path, number):
        name = [key.name for key in path if isinstance(key, jax.tree_util.GetAttrKey)][-1]
        return number * unit ** POWERS[name] if name in POWERS else number

    def relaxing(law):
        if not isinstance(law, jp.ZenerRod):
            return law
        times = {name: getattr(law, name) * unit**-law.order for name in ("tau_f", "tau_x")}
        return dataclasses.replace(law, **times)

    parts = jax.tree_util.tree_map_with_path(in_unit, parts)
    return jax.tree.map(relaxing, parts, is_leaf=lambda part: isinstance(part, jp.ZenerRod))


def displacements_in_units(system, steps, end, ground=SHAKING, start=None, scheme=RESOLVED):
    """Of runs of these steps by one program, until ``end`` at the last step and later at others."""
    grid = jp.TimeGrid(steps[0], round(end / steps[-1]))
    start = jp.InitialState() if start is None else start
    case = jax.tree.map(lambda x: jnp.asarray(x, float), (system, ground, start))
    return np.asarray(_displacements(jnp.asarray(steps) / grid.dt, case, grid, scheme))


@partial(jax.jit, static_argnums=(2, 3))
@partial(jax.vmap, in_axes=(0, None, None, None))
def _displacements(unit, case, grid, scheme):
    system, ground, start = in_unit_of_time(unit, *case)
    response = jp.simulate(system, ground, grid, scheme, initial=start)
    return jnp.stack([mass.x for mass in response.masses])


def growth(systems, grounds):
    """``jp.study.perturbation_growth`` over ``GRID``, one by one: a batch costs more to compile."""
    cases = zip(systems, map(padded, grounds), strict=True)
    each = [_growth(*jax.tree.map(lambda x: jnp.asarray(x, float), case)) for case in cases]
    return jax.tree.map(lambda *x: np.stack(x), *each)


_run = jax.jit(jax.vmap(lambda system, ground: jp.simulate(system, ground, GRID)))
_growth = jax.jit(lambda system, ground: jp.study.perturbation_growth(system, ground, GRID))


def run(systems, grounds):
    """Responses over ``GRID``, by a program for so many lanes and wavelets; spare lanes rest."""
    grounds = [padded(ground) for ground in grounds]
    spare = -len(systems) % LANES
    systems = [*systems, *[systems[0]] * spare]
    grounds = [*grounds, *[padded(jp.Ricker(0.0, [], []))] * spare]
    batches = [slice(i, i + LANES) for i in range(0, len(systems), LANES)]
    results = [jax.device_get(_run(stacked(systems[x]), stacked(grounds[x]))) for x in batches]
    return jax.tree.map(lambda *x: np.concatenate(x)[: len(systems) - spare], *results)


def padded(ground, wavelets=WAVELETS):
    """The same ground with wavelets of no amplitude added."""
    periods = np.asarray(ground.periods, float)
    missing = wavelets - periods.size
    amplitude = np.broadcast_to(ground.amplitude, periods.shape)
    return jp.Ricker(
        np.pad(amplitude, (0, missing)),
        np.pad(periods, (0, missing), constant_values=1.0),
        np.pad(np.asarray(ground.arrivals, float), (0, missing)),
    )


def stacked(trees):
    return jax.tree.map(lambda *x: jnp.asarray(np.stack(x), float), *trees)
