"""Peaks of an isolated building with Rayleigh's damping beside those of a book.

Examples 4 and 5 of chapter 11 of Cui, Shen and Yang, Structural Seismic Response Analysis
Programming and Application (China Architecture & Building Press 2022), for a file with the 1,900
samples of their record, of .01 s: python -m benchmarks.rayleigh RECORD. "Converged" are peaks of
Newmark's method with steps so short that the digits stand.
"""

import argparse
from dataclasses import replace

import jax
import numpy as np

import jaxpound as jp
from benchmarks.verification.damping import frame

PEAK, DT, END = 0.40 * 9.81, 0.01, 18.99
YIELD = {"yield_force": (500e3, 1225e3, 975e3, 490e3), "hardening": (0.05, 0.0, 0.0, 0.0)}
NUMBERS = {  # printed, converged
    "example 5: displacement of the roof, m": (0.028148812301, 0.0282023),
    "example 5: of the isolator, m": (0.023147668727, 0.0231701),
    "example 5: force of the isolator, N": (532869.17182, 532925.3),
    "example 5: acceleration of the roof relative to the ground, m/s²": (5.0791572381, 5.1389),
    "example 4: displacement of the roof, m": (0.036022644844, 0.0360279),
    "example 4: of the isolator, m": (0.025045285909, 0.0250882),
    "example 4: acceleration of the roof relative to the ground, m/s²": (5.395365565, 5.4349),
}


def peaks(building: jp.ShearBuilding, record: jp.Record, step: float) -> list[float]:
    """Peaks of roof and isolator, of the isolator's spring and of the roof's acceleration."""
    response = jp.simulate(jp.Buildings((building,)), record, jp.TimeGrid.until(END, step))
    relative = response.absolute_accelerations[-1] - response.ground_acceleration
    masses, (isolator, *_) = response.demand.masses, response.demand.rods
    largest = float(np.abs(relative).max())
    return [*map(float, (masses[-1].peak_x, masses[0].peak_x, isolator.peak_force, largest))]


def main() -> None:
    """Print all numbers, by step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("record", help="file of samples, of any unit: they are scaled")
    jax.config.update("jax_enable_x64", True)
    samples = np.loadtxt(parser.parse_args().record).ravel()
    samples *= PEAK / np.abs(samples).max() / jp.STANDARD_GRAVITY
    record, steps = jp.Record(samples, DT), (0.01, 0.005, 0.0025)
    storeys = frame().storeys
    viscous = replace(frame(), storeys=(replace(storeys[0], dashpot=1e6), *storeys[1:]))
    weak = frame(**YIELD)
    columns = [peaks(weak, record, h) + (x := peaks(viscous, record, h))[:2] + x[3:] for h in steps]
    print("| | printed | converged |", *(f"{1e3 * h:g} ms, off by |" for h in steps))
    for (name, (printed, converged)), values in zip(
        NUMBERS.items(), zip(*columns, strict=True), strict=True
    ):
        errors = " | ".join(f"{x / converged - 1:+.1e}" for x in values)
        print(f"| {name} | {printed:.8g} | {converged:.7g} | {errors} |")


if __name__ == "__main__":
    main()
