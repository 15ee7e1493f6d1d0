"""Run the verification suite, or some of its cases, and write its page of the documentation.

    python -m benchmarks.verification                  # all cases: some twenty minutes
    python -m benchmarks.verification rods rows        # some of them
    python -m benchmarks.verification --page           # the page anew, from the results on file
    python -m benchmarks.verification --list

Results go to ``benchmarks/verification/results.json``, the page and its figure into ``docs``. A
case that does not hold is not written; it is named, and the exit status is 1.
"""

import argparse
import dataclasses
import os
import platform
import re
import sys
import time
from datetime import date
from pathlib import Path

import jax

import jaxpound as jp
from benchmarks.verification import page
from benchmarks.verification.case import Case
from benchmarks.verification.cases import CASES
from benchmarks.verification.equal_error import ratios


def tried(name: str) -> Case:
    """A case with its wall time, and by what it was computed."""
    start = time.perf_counter()
    case = CASES[name]()
    seconds = time.perf_counter() - start
    return dataclasses.replace(case, seconds=seconds, made=f"{date.today()}, {machine()}")


def machine() -> str:
    """The versions and the processor that times depend on."""
    python = ".".join(platform.python_version_tuple()[:2])
    cpus = Path("/proc/cpuinfo")
    models = re.findall(r"model name\s*: (.*)", cpus.read_text()) if cpus.exists() else []
    processor = models[0] if models else platform.processor()
    versions = f"jaxpound {jp.__version__}, JAX {jax.__version__}, Python {python}"
    return f"{versions}, {os.cpu_count()} cores of {processor or platform.machine()}"


def told(case: Case) -> None:
    """A line for each result, and for each that does not hold."""
    print(f"{case.title}: {case.skipped or f'{case.seconds:.0f} s'}")
    for part in case.errors:
        errors = ", ".join(f"{error:.1e}" for error in part.errors)
        order = part.fitted_order
        print(f"  {part.quantity}: {errors}" + (f"; order {order:.2f}" if order else ""))
    for part in case.numbers:
        print(f"  {part.quantity}: {part.found:.6g}, known {part.known:.6g} ± {part.within:.1g}")
    for one in ratios(case.curves):
        batch = f", {one.of_batch:.0f} of a batch's" if one.of_batch else ""
        print(
            f"  {one.panel}: at {one.error:.1e} {one.program.partition(',')[0]} takes "
            f"{one.of_run:.0f} times one run's time{batch}"
        )
    for fault in case.faults():
        print(f"  FAILS: {fault}")
    sys.stdout.flush()


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.verification", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help="of these cases; default: all")
    parser.add_argument("--list", action="store_true", help="the names of the cases")
    parser.add_argument("--page", action="store_true", help="write the page only")
    args = parser.parse_args()
    unknown = set(args.cases) - set(CASES)
    if unknown:
        parser.error(f"no case {', '.join(sorted(unknown))}: there are {', '.join(CASES)}")
    if args.list:
        print("\n".join(CASES))
        return 0
    jax.config.update("jax_enable_x64", True)
    failed = []
    for name in [] if args.page else args.cases or CASES:
        case = tried(name)
        told(case)
        if case.faults():
            failed.append(name)
        elif not case.skipped:
            page.keep(name, case)
    page.write()
    if failed:
        print(f"These cases do not hold: {', '.join(failed)}")
    return 1 if failed else 0
