"""Pairs that may touch, run many at once: a program for each kind of law, not for each run."""

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from jaxpound.model.contact import with_mass
from tests.simulation.contact.test_flows import LAWS

GRID = jp.TimeGrid(0.02, 3200)
SHAKING = jp.Ricker(0.4, [1.25, 2.0, 3.5], [2.5, 3.5, 6.0])
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
    laws = [LAWS[one](stiffness if "kelvin" in one else hertz, restitution) for one in among]
    return OneOf(float(among.index(name)), tuple(laws))


def pair(masses, materials, stiffnesses, **link):
    rods = zip(materials, stiffnesses, (0, 1), strict=True)
    return jp.System(
        masses=masses,
        rods=tuple(jp.Rod(material, k, (i, jp.GROUND)) for material, k, i in rods),
        links=(jp.Link((0, 1), **link),),
    )


def in_unit_of_time(unit, system, ground):
    """The same run in another unit of time, so that a step of the grid is ``unit`` times as long.

    Runs with shorter steps so need no program of their own. Forces are in units of mass times
    length over time squared, relaxation times to the power of the order in those of time.
    """

    def in_unit(law):
        if isinstance(law, OneOf):
            return OneOf(law.which, tuple(map(in_unit, law.laws)))
        if isinstance(law, jp.ZenerRod):
            times = {name: getattr(law, name) * unit**-law.order for name in ("tau_f", "tau_x")}
            return dataclasses.replace(law, **times)
        if law is None or isinstance(law, jp.Newton | jp.Bilinear | jp.BoucWen):
            return law
        if isinstance(law, jp.PowerLaw):
            return dataclasses.replace(law, force=law.force * unit**2, velocity=law.velocity * unit)
        if isinstance(law, jp.VelocityFriction):
            return jp.VelocityFriction(law.increase * unit**2, law.velocity * unit)
        return dataclasses.replace(law, stiffness=law.stiffness * unit**2)

    rods = [
        dataclasses.replace(rod, stiffness=rod.stiffness * unit**2, material=in_unit(rod.material))
        for rod in system.rods
    ]
    links = [
        dataclasses.replace(
            link,
            friction=link.friction * unit**2,
            contact=in_unit(link.contact),
            velocity_friction=in_unit(link.velocity_friction),
        )
        for link in system.links
    ]
    ground = dataclasses.replace(
        ground,
        periods=jnp.asarray(ground.periods) / unit,
        arrivals=jnp.asarray(ground.arrivals) / unit,
    )
    return dataclasses.replace(system, rods=tuple(rods), links=tuple(links)), ground


def displacements_in_units(system, steps, end, ground=SHAKING):
    """Of runs of these steps by one program, until ``end`` at the last step and later at others."""
    grid = jp.TimeGrid(steps[0], round(end / steps[-1]))
    case = jax.tree.map(lambda x: jnp.asarray(x, float), (system, ground))
    return np.asarray(_displacements(jnp.asarray(steps) / grid.dt, case, grid))


@partial(jax.jit, static_argnums=2)
@partial(jax.vmap, in_axes=(0, None, None))
def _displacements(unit, case, grid):
    response = jp.simulate(*in_unit_of_time(unit, *case), grid)
    return jnp.stack([mass.x for mass in response.masses])


def run(systems, grounds):
    """Responses over ``GRID``, of a batch of any size."""
    return _in_batches(_run, systems, grounds)


def growth(systems, grounds):
    """``jp.growth`` over ``GRID``, of one after the other: a batch costs more to compile."""
    cases = zip(systems, map(padded, grounds), strict=True)
    each = [_growth(*jax.tree.map(lambda x: jnp.asarray(x, float), case)) for case in cases]
    return jax.tree.map(lambda *x: np.stack(x), *each)


_run = jax.jit(jax.vmap(lambda system, ground: jp.simulate(system, ground, GRID)))
_growth = jax.jit(lambda system, ground: jp.growth(system, ground, GRID))


def _in_batches(of_all, systems, grounds):
    """A program is for a given number of lanes and of wavelets; lanes to spare stay at rest."""
    grounds = [padded(ground) for ground in grounds]
    spare = -len(systems) % LANES
    systems = [*systems, *[systems[0]] * spare]
    grounds = [*grounds, *[padded(jp.Ricker(0.0, [], []))] * spare]
    found = [
        jax.device_get(of_all(stacked(systems[i : i + LANES]), stacked(grounds[i : i + LANES])))
        for i in range(0, len(systems), LANES)
    ]
    n = len(systems) - spare
    return jax.tree.map(lambda *x: np.concatenate(x)[:n], *found)


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
