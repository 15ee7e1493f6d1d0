"""The cases by name, in the order of the page."""

from benchmarks.verification import (
    collisions,
    columns,
    coulomb_decay,
    damping,
    den_hartog,
    el_centro,
    energy,
    gradients,
    opensees_peer,
    paper_case,
    rare_events,
    rods,
    rows,
    siconos_peer,
    soil,
    yielding,
)

CASES = {
    "rods": rods.case,
    "el_centro": el_centro.case,
    "den_hartog": den_hartog.case,
    "damping": damping.case,
    "coulomb_decay": coulomb_decay.case,
    "collisions": collisions.case,
    "paper_case": paper_case.case,
    "rows": rows.case,
    "columns": columns.case,
    "soil": soil.case,
    "yielding": yielding.case,
    "energy": energy.case,
    "gradients": gradients.case,
    "rare_events": rare_events.case,
    "opensees": opensees_peer.case,
    "siconos": siconos_peer.case,
}
