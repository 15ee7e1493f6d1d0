"""``jaxpound montecarlo``: a study of buildings under random earthquakes."""

from __future__ import annotations

import argparse
import dataclasses
import re
import shlex
import sys
from collections.abc import Iterator
from typing import Annotated, Literal

import jaxpound as jp
from jaxpound._checks import count
from jaxpound.cli.parameters import Uncertain
from jaxpound.cli.reading import Count, File, Section, Seed, between, refused
from jaxpound.simulation.time_steps import natural_periods

_Correlation = Annotated[float, between(-1, 1, "", "of the same parameter of storeys")]


class Sampling(Section):
    """Number of scenarios, method of sampling, and the stored quantities."""

    samples: Annotated[int, Count] = 10_000
    seed: Annotated[int, Seed] = 0
    sampling: Literal["plain", "sobol"] = "plain"
    chunk_size: Annotated[int, Count] | None = None
    keep_failures: bool = False
    spectral_acceleration: bool = False
    correlation: _Correlation | None = None


class StudyConfig(Uncertain):
    """The configuration of ``jaxpound montecarlo``."""

    study: Sampling = Sampling()


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    file = File.opened(args.config, "montecarlo")
    config = file.read(StudyConfig)
    options = config.study
    scenarios, grid = prepared(file, config)
    samples = options.samples if args.samples is None else args.samples
    periods = natural_periods(config.buildings) if options.spectral_acceleration else []
    measures = {
        f"spectral_acceleration_{i}": jp.study.SpectralAcceleration.of(config.buildings, x, grid)
        for i, x in enumerate(periods, 1)
    }
    storage = jp.Storage(
        args.store,
        chunk_size=options.chunk_size,
        measures=measures,
        keep_parameters=True,
        keep_failures=options.keep_failures,
        notes={"configuration": file.text},
        shard=_shard(args.shard),
    )
    if args.commands is not None:
        print(*commands(args, storage, samples), sep="\n")
        return
    study = jp.monte_carlo(
        scenarios,
        samples,
        grid,
        config.run.scheme,
        options.seed,
        sampling=options.sampling,
        store=storage,
        strict=args.strict,
        progress=sys.stderr.isatty(),
    )
    print(study)
    part = "" if args.shard == "1/1" else f" by shard {args.shard} alone"
    print(f"probability of pounding{part}{study.checked_floors} {study.pounding_probability()}")
    print(f"jaxpound report --store {args.store} --out DIR says more")


def _shard(text: str) -> tuple[int, int]:
    shard = re.fullmatch(r"(\d+)/(\d+)", text)
    if not shard or not 1 <= int(shard[1]) <= int(shard[2]):
        rule = "must be I/N with I from 1 to N, such as 2/8"
        raise ValueError(f"argument --shard: {text!r} {rule}")
    return int(shard[1]), int(shard[2])


def commands(args: argparse.Namespace, storage: jp.Storage, samples: int) -> Iterator[str]:
    """Commands, as a shell reads them, that together make the study of one command.

    Raises ``ValueError`` if their number is not positive or exceeds that of the chunks, or if the
    command is itself a shard.
    """
    n = count("argument --commands", args.commands)
    if args.shard != "1/1":
        raise ValueError(f"argument --commands: not allowed with --shard {args.shard}")
    size = storage.sized(count("n", samples))
    dataclasses.replace(storage, shard=(n, n)).chunks(samples, size)
    words = ["jaxpound", args.command, str(args.config)]
    for name, value in vars(args).items():
        if name not in ("command", "config", "commands", "shard") and value not in (None, False):
            words.append(f"--{name}" if value is True else f"--{name}={value}")
    for i in range(1, n + 1):
        yield shlex.join([*words, f"--shard={i}/{n}"])


def prepared(file: File, config: StudyConfig) -> tuple[jp.Scenarios, jp.TimeGrid]:
    """The scenarios of a study and the time grid of its runs."""
    if not config.layout.gaps:
        rule = "must have a gap: the study is of how often gaps close"
        raise refused(f"{file.name}: a [[link]]", rule)
    return config.scenarios(file, config.study.correlation)
