"""Results that no run made, by the flat names of the pair: one link between two masses on rods."""

import dataclasses

import numpy as np
from hypothesis import strategies

import jaxpound as jp
from jaxpound.model.ends import elongation
from jaxpound.results.element_demands import LinkDemand, MassDemand, RodDemand
from jaxpound.results.elements import place_of
from jaxpound.results.impacts import ImpactSeries
from jaxpound.results.response import LinkResponse, MassResponse, RodResponse

SCALARS = ("min_gap", "min_gap_time", "peak_x1", "peak_x2", "peak_f1", "peak_f2")
SCALARS += ("peak_acceleration_1", "peak_acceleration_2", "slip_distance", "friction_work")
SCALARS += ("residual_offset", "pga", "pgv")
OF_LINKS = ("gap", "friction", "slip_velocity", "phase", "change_time")
SERIES = ("x1", "x2", "v1", "v2", "f1", "f2", *OF_LINKS, "ground_acceleration", "ground_velocity")
OF_CONTACT = ("peak_contact", "peak_impulse", "peak_penetration", "n_impacts", "first_impact_time")
OF_CONTACT += ("contact_work", "soft_peak_contact")


def pair_demand(value, soft=None, contact=False):
    """The scalars of a pair, all of one value; with ``contact`` those of a law of contact too."""
    of_contact = dict.fromkeys(OF_CONTACT, value) if contact else {}
    link = LinkDemand(*[value] * 5, soft_min_gap=soft, **of_contact)
    return jp.Demand(
        (MassDemand(value, value),) * 2, (RodDemand(value),) * 2, (link,), value, value
    )


def pair_response(time, series, masses=(1.0, 1.0), demand=None, slip_force=0.0):
    """The response of a pair, of series by flat name; what is not given is zero."""
    every = dict.fromkeys(SERIES, np.zeros(len(time))) | series
    every["slip_velocity"] = series.get("slip_velocity", every["v1"] - every["v2"])
    of_link = {name: every[name] for name in OF_LINKS}
    return jp.Response(
        time=time,
        ground_acceleration=every["ground_acceleration"],
        ground_velocity=every["ground_velocity"],
        masses=tuple(MassResponse(every[f"x{i}"], every[f"v{i}"], masses[i - 1]) for i in (1, 2)),
        rods=tuple(RodResponse(every[f"f{i}"], (i - 1, jp.GROUND)) for i in (1, 2)),
        links=(LinkResponse(**of_link, ends=(0, 1), slip_force=slip_force),),
        demand=pair_demand(0.0) if demand is None else demand,
    )


def changed(result, **values):
    """A result with other values of some of its quantities, by flat name."""
    for name, value in values.items():
        place = place_of(type(result), name)
        if place is None or not place.group:
            result = dataclasses.replace(result, **{name: value})
            continue
        items = list(getattr(result, place.group))
        items[place.element] = dataclasses.replace(items[place.element], **{place.field: value})
        result = dataclasses.replace(result, **{place.group: tuple(items)})
    return result


def in_si(structures, scales):
    """The paper's two structures as buildings with a link, by eq. (8)."""
    both = []
    for rod, mass, k in (
        (structures.rod_1, 1.0, 1.0),
        (structures.rod_2, 1 / structures.mass_ratio, structures.stiffness_ratio),
    ):
        tau_f, tau_x = (tau / scales.frequency**rod.order for tau in (rod.tau_f, rod.tau_x))
        stiffness = k * scales.mass * scales.frequency**2
        both.append(jp.Building(mass * scales.mass, stiffness, rod.order, tau_f, tau_x))
    friction, gap = structures.friction * scales.force, structures.initial_gap * scales.length
    return jp.Buildings(tuple(both), (jp.FloorLink(0, 0, friction=friction, gap=gap),))


STEEL = jp.Rod(jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05), stiffness=5.0)


def row_of(n_floors, links=()):
    """Buildings of so many floors, of masses 1."""
    return jp.Row(tuple(jp.Storeys((1.0,) * n, STEEL) for n in n_floors), links)


def row_response(row, time, displacement):
    """A response of a row whose mass i moves by ``displacement(i, time)``.

    Friction is 0.1 times the slip velocity, a force of contact 10 times the penetration.
    """
    system, step = row.system(), time[1] - time[0]
    x = [displacement(i, time) for i in range(len(system.masses))]
    v = [np.gradient(path, step) for path in x]
    links, of_links = [], []
    for link in system.links:
        gap, w = link.gap - elongation(link, x), elongation(link, v)
        of_contact, scalars = {}, {}
        if link.contact is not None:
            force, closed = np.maximum(-10 * gap, 0.0), gap <= 0
            begins = time[1:][closed[1:] & ~closed[:-1]]
            fields = ("end", "approach_velocity", "rebound_velocity", "impulse", "peak_force")
            series = {name: np.ones_like(begins) for name in fields} | {"end": begins + step}
            of_contact = dict.fromkeys(("contact_stored", "contact_lost", "friction_work"), 0 * w)
            of_contact |= {"contact": force, "touching": closed.astype(float)}
            of_contact["impacts"] = ImpactSeries(time=begins, **series)
            scalars = dict.fromkeys(OF_CONTACT, 0.0) | {"n_impacts": float(begins.size)}
            scalars["peak_contact"] = force.max()
        series = gap, 0.1 * w, w, 0 * w, 0 * w
        links.append(LinkResponse(*series, link.ends, slip_force=link.friction, **of_contact))
        least = gap.argmin()
        of_links.append(LinkDemand(gap[least], time[least], 1.0, 1.0, 0.0, **scalars))
    ends = [rod.ends for rod in system.rods]
    forces = [5.0 * elongation(rod, x) for rod in system.rods]
    peaks = [np.abs(force).max() for force in forces]
    inner = [min(of_rod) >= 0 for of_rod in ends]
    drifts = [peak / 5.0 if inside else None for peak, inside in zip(peaks, inner, strict=True)]
    masses = tuple(MassDemand(np.abs(path).max(), 1.0) for path in x)
    rods = tuple(map(RodDemand, peaks, drifts))
    return jp.Response(
        time=time,
        ground_acceleration=np.cos(time),
        ground_velocity=np.sin(time),
        masses=tuple(MassResponse(*motion, 1.0) for motion in zip(x, v, strict=True)),
        rods=tuple(map(RodResponse, forces, ends)),
        links=tuple(links),
        demand=jp.Demand(masses, rods, tuple(of_links), pga=1.0, pgv=1.0, topology=system.topology),
    )


def log_uniform(low, high):
    """Numbers for tests of any of them, their logarithms evenly spread."""
    return strategies.floats(np.log10(low), np.log10(high)).map(lambda x: 10.0**x)
