"""Moreau and Jean's time stepping of a pair by Siconos, in a process of its own.

    python siconos_run.py PROBLEM.npz FOUND.npz

Siconos comes for the system's Python; this script needs it and NumPy only. PROBLEM has the matrices
``mass``, ``damping`` and ``stiffness`` of M q″ + C q′ + K q = −M (1, 1, 0, …) u″, the limit
``friction`` of the force between the first two coordinates, their ``gap`` and Newton's
``restitution`` (not a number: no contact), ``steps``, for step i the mean of u″ over each step
``acceleration_i``, and how many ``rounds`` to time. FOUND gets for step i ``motion_i``, with x1,
x2, v1, v2 at all instants, ``seconds``: the shortest wall time of the loop over the steps, and the
``version`` of Siconos.
"""

import sys
import time

import numpy as np
import siconos
import siconos.kernel as kernel


def simulation(given, h, n_steps):
    """The pair, at rest, and the vector of forces on it, which the loop sets."""
    size = len(given["mass"])
    blocks = kernel.LagrangianLinearTIDS(
        np.zeros(size), np.zeros(size), given["mass"], given["stiffness"], given["damping"]
    )
    blocks.setFExtPtr(np.zeros(size))
    model = kernel.NonSmoothDynamicalSystem(0.0, (n_steps + 1) * h)
    model.insertDynamicalSystem(blocks)
    closing = np.zeros((1, size))
    closing[0, :2] = 1.0, -1.0

    def link(law, way, offset):
        relation = kernel.LagrangianLinearTIR(way * closing, np.array([offset]))
        model.link(kernel.Interaction(law, relation), blocks)

    # Multipliers are impulses of a step. An interaction acts while its distance is not positive,
    # which for friction is always: it has velocities only.
    slip = h * float(given["friction"])
    link(kernel.RelayNSL(1, -slip, slip), 1.0, -1000.0)
    problem = kernel.Relay()
    if np.isfinite(given["restitution"]):
        link(kernel.NewtonImpactNSL(float(given["restitution"])), -1.0, float(given["gap"]))
        problem = kernel.GenericMechanical()
        problem.numericsSolverOptions().dparam[0] = 1e-12
    stepping = kernel.TimeStepping(
        model, kernel.TimeDiscretisation(0.0, h), kernel.MoreauJeanOSI(0.5), problem
    )
    return stepping, blocks


def run(given, h, acceleration):
    """Motion, shape (steps + 1, 4), and the wall time of the loop."""
    stepping, blocks = simulation(given, h, len(acceleration))
    force, x, v = blocks.fExt(), blocks.q(), blocks.velocity()
    found = np.zeros((len(acceleration) + 1, 4))
    loads = -acceleration[:, None] * np.diag(given["mass"])[:2]
    start = time.perf_counter()
    for i, load in enumerate(loads, start=1):
        force[:2] = load
        stepping.computeOneStep()
        found[i, :2], found[i, 2:] = x[:2], v[:2]
        stepping.nextStep()
    return found, time.perf_counter() - start


def main():
    given = np.load(sys.argv[1])
    found, seconds = {}, np.full(len(given["steps"]), np.inf)
    for _ in range(int(given["rounds"])):
        for i, h in enumerate(given["steps"]):
            found[f"motion_{i}"], loop = run(given, float(h), given[f"acceleration_{i}"])
            seconds[i] = min(seconds[i], loop)
    np.savez(sys.argv[2], seconds=seconds, version=siconos.version, **found)


if __name__ == "__main__":
    main()
