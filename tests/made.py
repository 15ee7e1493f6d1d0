"""Results that no run made, by the flat names of the pair: one link between two masses on rods."""

import dataclasses

import numpy as np

import jaxpound as jp
from jaxpound.results.elements import place_of
from jaxpound.results.response import LinkResponse, MassResponse, RodResponse

SCALARS = (
    *("min_gap", "min_gap_time", "peak_x1", "peak_x2", "peak_f1", "peak_f2"),
    *("peak_acceleration_1", "peak_acceleration_2", "slip_distance", "friction_work"),
    *("residual_offset", "pga", "pgv"),
)
OF_LINKS = ("gap", "friction", "slip_velocity", "phase", "change_time")
SERIES = (
    *("x1", "x2", "v1", "v2", "f1", "f2", *OF_LINKS),
    *("ground_acceleration", "ground_velocity"),
)


OF_CONTACT = (
    *("peak_contact", "peak_impulse", "peak_penetration", "n_impacts", "first_impact_time"),
    *("contact_work", "soft_peak_contact"),
)


def pair_demand(value, soft=None, contact=False):
    """The scalars of a pair, all of one value; with ``contact`` those of a law of contact too."""
    more = {} if soft is None else {"soft_min_gap": soft}
    more |= dict.fromkeys(OF_CONTACT, value) if contact else {}
    return jp.Demand.of_columns(dict.fromkeys(SCALARS, value) | more, si=False)


def pair_response(time, series, masses=(1.0, 1.0), demand=None):
    """The response of a pair, of series by flat name; what is not given is zero."""
    given = dict.fromkeys(SERIES, np.zeros(len(time))) | series
    given["slip_velocity"] = series.get("slip_velocity", given["v1"] - given["v2"])
    return jp.Response(
        time=time,
        ground_acceleration=given["ground_acceleration"],
        ground_velocity=given["ground_velocity"],
        masses=tuple(
            MassResponse(given[f"x{i}"], given[f"v{i}"], m) for i, m in enumerate(masses, 1)
        ),
        rods=tuple(RodResponse(given[f"f{i}"], (i - 1, jp.GROUND)) for i in (1, 2)),
        links=(LinkResponse(**{name: given[name] for name in OF_LINKS}, ends=(0, 1)),),
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
