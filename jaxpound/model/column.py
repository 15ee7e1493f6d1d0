"""A column that a floor of the neighbour hits between two floors."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import Range, require_one_of
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger
from jaxpound._fields import Batch, parameter, pytree_dataclass, static, unchecked
from jaxpound.model.contact import KelvinVoigt

_RIGIDITY = Range(1e-6, 1e14, "N m²", "E I of a model's column to that of all columns of a tower")
_CAPACITY = Range(1e-6, 1e12, "N", "a shear force")


@pytree_dataclass
class Column(Batch):
    r"""The columns of a storey that a floor of the neighbour hits, as one without mass.

    Hit at the share ξ of the height l of its storey, a column bends. The point moves by the share
    :math:`1 - w` of the floor below and w of the floor above, which take the same shares of the
    force, and by the force over a stiffness: built in, :math:`w = 3 ξ^2 - 2 ξ^3` and :math:`k_c =
    3 E I/(l^3 ξ^3 (1-ξ)^3)`; pinned, :math:`w = ξ` and :math:`k_c = 3 E I/(l^3 ξ^2 (1-ξ)^2)`.

    Contact and column act in series. In the place of k and the dashpot c of ``KelvinVoigt``, the
    only law for columns, stand k s and c s², with the contact's share s = k_c/(k + k_c) of the
    motion. For the spring this is exact; of the dashpot it is the limit of slow impacts: with e =
    .65 and s below .3, as is usual, forces and speeds of an impact are within 1 %. A column is
    elastic, and returns nearly all energy if it is soft.

    Raises ``ValueError`` if a concrete value breaks its rule.

    Parameters
    ----------
    rigidity
        Flexural rigidity E I > 0, N m²; of several columns that the floor hits, their sum.
    ends
        "fixed", built in at both floors, or "pinned".
    capacity
        Shear force > 0 that the columns can take, N, for demand over capacity. None by default.
    position, height
        ξ, in (0, 1), from the floor below, and l > 0, m. Of links between ``ShearBuilding`` they
        follow from the elevations; in a ``Row`` they must be stated, all in its units.
    side
        Whose columns they are: those of the building on the "left" or "right" of the link. By
        default those of the higher floor that the link names; in a ``Row`` on the right.

    Examples
    --------
    A column of 0.4 m by 0.4 m, half as stiff as it is cracked, 2 m above the floor below:

    >>> rigidity = 0.5 * 30e9 * 0.4**4 / 12
    >>> column = jp.model.Column(rigidity, position=2 / 3, height=3.0)
    >>> round(column.weight, 4), f"{column.stiffness:.3g} N/m"
    (0.7407, '3.24e+08 N/m')
    """

    rigidity: Any = parameter("EI", "rigidity", "flexural rigidity", above=0, within=_RIGIDITY)
    ends: str = static(default="fixed")
    capacity: Any = parameter(
        "V", "force", "shear capacity", above=0, within=_CAPACITY, default=None
    )
    position: Any = parameter(r"\xi", words="position of impact", above=0, below=1, default=None)
    height: Any = parameter("l", "length", "storey height", above=0, default=None)
    side: str | None = static(default=None)

    def __post_init__(self) -> None:
        require_one_of(self.ends, ("fixed", "pinned"), "ends")
        require_one_of(self.side or "right", ("left", "right"), "side")
        super().__post_init__()

    @property
    def weight(self) -> Any:
        """w, the share of the force that the floor above takes."""
        x = self._known_position()
        return x**2 * (3 - 2 * x) if self.ends == "fixed" else x

    @property
    def stiffness(self) -> Any:
        """The force at the point of impact over its deflection between floors at rest."""
        x = self._known_position()
        arms = (x * (1 - x)) ** (3 if self.ends == "fixed" else 2)
        return 3 * self.rigidity / (self.height**3 * arms)

    def _known_position(self) -> Any:
        if self.position is None or self.height is None:
            raise InvalidInput("position", "None", "must be known, and height: Buildings know them")
        return self.position

    def behind(self, law: Any) -> Any:
        """Kelvin and Voigt's law of contact with the column in series; None without a law."""
        if law is None:
            return None
        share = self.stiffness / (law.stiffness + self.stiffness)
        ratio = law.damping_ratio * share**1.5
        restitution = jnp.exp(-math.pi * ratio / jnp.sqrt(1 - ratio**2))
        numbers = {"stiffness": law.stiffness * share, "restitution": restitution}
        return unchecked(KelvinVoigt, **numbers, tension=law.tension)

    def shear(self, force: Any) -> Any:
        """The larger shear under a force of contact: w of it above, 1 − w below."""
        return larger(self.weight, 1 - self.weight) * force
