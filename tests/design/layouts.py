"""Dimensionless pairs as the command line reads them."""

import jaxpound as jp
from jaxpound.cli.buildings import BuildingsLayout
from jaxpound.cli.parameters import Parameters


def parameters_of_pair(structures, scales):
    left, right, friction_force, gap = scales.buildings(structures)
    law = scales.contact_to_si(structures.contact)
    link = jp.FloorLink(0, 0, friction=friction_force, gap=gap, contact=law)
    return Parameters(BuildingsLayout.of(jp.Buildings((left, right), (link,))))
