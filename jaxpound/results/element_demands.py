"""The scalars of a mass, a rod and a link."""

from __future__ import annotations

from functools import partial
from typing import Any

from jaxpound._fields import pytree_dataclass, quantity


def _scalar(
    rank: int, kind: str | None, words: str, symbol: str = "*", column: str = "*", **more: Any
) -> Any:
    """A ``quantity`` in the order of tables; its column is by default its field's name."""
    return quantity(kind, words, column, symbol, rank=rank, **more)


_peak = partial(_scalar, limited=True)
_contact = partial(_scalar, only="contact", limited=True, default=None)
_column = partial(_scalar, limited=True, default=None)
_yields = partial(_scalar, column="*_{}", only="yielding", limited=True, default=None)


@pytree_dataclass
class MassDemand:
    """Scalars of a mass."""

    peak_x: Any = _peak(2, "length", "peak displacement of building {}", "peak $|x_{}|$", "*{}")
    """Largest |x|, displacement relative to the ground; where supports move apart, to support 0."""
    peak_acceleration: Any = _peak(
        4, "acceleration", "peak absolute acceleration of building {}", "peak $|a_{}|$", "*_{}"
    )
    """Largest absolute acceleration |x'' + u''|, contact forces included; by ``Newton``'s law,
    whose impacts have no force, the largest between impacts."""


@pytree_dataclass
class RodDemand:
    """Scalars of a rod."""

    peak_force: Any = _peak(
        3, "force", "peak base shear of building {}", "peak $|f_{}|$", "peak_f{}"
    )
    """Largest |f|, the rod's force (of a rod to the ground, the base shear)."""
    peak_drift: Any = _peak(
        *(2, "length", "peak drift of storey {}", "peak drift $|d_{}|$", "*_{}"),
        only="storey",
        default=None,
    )
    """Largest |e|, the elongation of a rod between two masses, or to a support that moves: the
    drift of a storey. None for a rod to the ground: its elongation is the displacement of its mass,
    ``peak_x``."""
    ductility: Any = _yields(18, None, "ductility of storey {}", r"ductility $\mu_{}$")
    """Largest |e| over the elongation e_y at yield. None, as all below, of a rod that never
    yields."""
    residual_drift: Any = _yields(19, "length", "residual drift of storey {}")
    """|e| that would be left if the rod were unloaded at the end of the run, e − f/K with the force
    f of its hysteresis."""
    dissipated_energy: Any = _yields(20, "energy", "dissipated energy of storey {}")
    """Energy dissipated by yielding, or by a viscous damper."""
    first_yield_time: Any = _yields(
        21, "time", "time of the first yield of storey {}", limited=False
    )
    """When |e| first exceeds e_y; infinite if it never does."""
    collapsed: Any = _yields(22, None, "collapse of storey {}", limited=False)
    """1 if |e| has exceeded the ultimate displacement of the rod's law, else 0."""


@pytree_dataclass
class LinkDemand:
    """Scalars of a link."""

    min_gap: Any = _scalar(0, "length", "smallest gap", r"* $\xi$")
    """Smallest gap ξ, where the slip velocity vanishes or at an end of the run."""
    min_gap_time: Any = _scalar(1, "time", "time of the smallest gap", "time of min gap $t$")
    """When the gap is smallest."""
    slip_distance: Any = _peak(5, "length", "distance slid by the damper")
    """Distance slid by the damper, ∫ |w| dt with the slip velocity w."""
    friction_work: Any = _peak(6, "energy", "energy taken by the damper")
    """Energy taken by the damper, ∫ q w dt."""
    residual_offset: Any = _peak(7, "length", "residual offset")
    """x_j − x_i at the end of the run: the change of the gap."""
    soft_min_gap: Any = _scalar(10, "length", "soft minimum of the gap", r"* $\xi$", default=None)
    """−T log of the mean of e^(−ξ/T) over the run, with the ``temperature`` T of ``demand``."""
    peak_contact: Any = _contact(11, "force", "peak contact force", "* force $p$")
    """Largest contact force p; by ``Newton``'s law, whose impacts have impulses but no force, the
    largest that presses blocks together at rest. None, as all below, without contact."""
    peak_impulse: Any = _contact(12, "impulse", "impulse of the strongest impact")
    """Impulse ∫ p dt of the strongest impact."""
    peak_penetration: Any = _contact(13, "length", "peak penetration", r"* $\delta$")
    """Largest penetration −ξ, 0 where the gap never closes."""
    n_impacts: Any = _contact(14, None, "number of impacts", "number of impacts", limited=False)
    """Touches after the link was apart, faster than 1e-4 of the fastest before."""
    first_impact_time: Any = _contact(
        15, "time", "time of the first impact", "time of first impact $t$", limited=False
    )
    """When the first impact begins; infinite if there is none."""
    contact_work: Any = _contact(16, "energy", "energy lost by contact", "energy lost by contact")
    """Energy lost by contact, the work of p less the energy stored in its spring."""
    peak_column_shear: Any = _column(
        23, "force", "peak shear of the column", "* $V$", only="column"
    )
    """Largest shear in a ``Column`` by contact, the larger of w p above and (1 − w) p below the
    point of impact, beside that of the storey. None, as all below, without a column."""
    column_shear_ratio: Any = _column(
        24, None, "shear of the column over its capacity", only="capacity"
    )
    """``peak_column_shear`` over the column's capacity; None without one."""
    peak_opening: Any = _column(
        25, "length", "largest opening beyond the gap at rest", only="supports"
    )
    """Largest gap of a joint less that at rest, by which a deck may lose its seat; 0 where it never
    opens, and of a link without a gap. None where no supports move apart."""
    soft_peak_contact: Any = _contact(
        17, "force", "soft maximum of the impacts' peak forces", "* force"
    )
    """(Σ P⁸)^(1/8) of all impacts' peak forces P: smooth also where two are equally strong. Zero by
    ``Newton``'s law, whose impacts have no force."""
