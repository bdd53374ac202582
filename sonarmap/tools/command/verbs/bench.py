"""`sonarmap bench`: how fast the kernels and the registration of a prepared pair are on this machine."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import MEASUREMENT, OUTPUT, flag, option
from sonarmap.tools.command.options.registration import SeedOption
from sonarmap.tools.command.options.running import DeviceOption, JsonOption
from sonarmap.tools.command.progress import progress
from sonarmap.tools.command.terminal import print_json, printable, say

DEFAULT_EDGES = (64, 128, 256)
UNRELIABLE, SLOWER = 3, 4
_measure, _output = partial(option, MEASUREMENT), partial(option, OUTPUT)


@dataclass(frozen=True, slots=True)
class Measurement:
    """What is measured."""

    grid: list[int] | None = _measure(
        "N", "Voxels per edge, 16..512; may be repeated. They are even products of 2, 3 and 5.", shown="64, 128 and 256"
    )
    repeats: int = _measure("R", "Number of timed runs of each kernel.", 15, min=1)
    pairs: int = _measure("P", "Simulated pairs to register; 0 is none.", 20, min=0)
    kernels: bool = flag(MEASUREMENT, "--kernels/--no-kernels", "Time the kernels.", True, rare=True)
    survey: int = _measure(
        "N", "Also map a simulated survey of N scans. It goes from files to files; 0 is none.", 0, min=0
    )
    device: DeviceOption = None
    seed: SeedOption = 0


@dataclass(frozen=True, slots=True)
class BenchFiles:
    """Where the result goes, and what it is compared with."""

    out: Path | None = _output("FILE", "Also write the result as JSON: one file to send.", None, "-o", "--out")
    compare: Path | None = _output(
        "OLD", "Say what differs from an earlier run. Differences within the noise of both do not count."
    )
    picture: Path | None = _output("FILE", "Draw the kernels and the device's limits, as PNG.", rare=True)
    page: Path | None = _output(
        "FILE", "Write the figures into a page at its marks. docs/benchmarks.md is such a page.", rare=True
    )
    from_: Path | None = _output("FILE", "Measure nothing; take an earlier run's result.", None, "--from", rare=True)


def command(measurement: Measurement, files: BenchFiles, as_json: JsonOption = False) -> None:
    """Time the kernels and the registration of pairs.

    Each kernel is timed beside its equivalents in NumPy, SciPy, pyfftw and pyvkfft. One whose result differs from the
    equivalent's is marked WRONG, and the exit code is 3. With --compare it is 4 if anything became slower beyond the
    noise.
    """
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.json_text import write_json
    from sonarmap.tools.lab.bench.output.compare import read_result, results_of

    old = read_result(files.compare) if files.compare else None
    for path in (files.out, files.picture, files.page):
        if path is not None:
            require_writable(path.parent)
    if files.from_ is not None:
        given = {"--grid": measurement.grid, "--survey": measurement.survey, "--device": measurement.device}
        if without := [name for name, value in given.items() if value]:
            raise InputError(f"--from measures nothing, so {', '.join(without)} has no effect; leave one of them out")
        result, wrong = read_result(files.from_), []
    else:
        result, wrong = _run(measurement, as_json)
    if files.out is not None:
        write_json(files.out, result)
    with results_of(files.from_):
        _show(result, files.picture, files.page)
    if wrong:
        names = ", ".join(wrong)
        say(f"the result differs from NumPy's or SciPy's: {names}; these times mean nothing", "error: ", "bold red")
        raise typer.Exit(UNRELIABLE)
    with results_of(files.compare):
        slower = old is not None and _compared(old, result)
    if slower:
        raise typer.Exit(SLOWER)


def _run(asked: Measurement, as_json: bool) -> tuple[dict[str, Any], list[str]]:
    """The result, printed, as JSON's types; and the kernels that are wrong."""
    from rich.console import Console

    from sonarmap.tools.files.writers.json_text import to_json
    from sonarmap.tools.lab.bench.output.table import describe
    from sonarmap.tools.lab.bench.run import BenchPlan, run_bench

    plan = BenchPlan(
        edges=list(dict.fromkeys(asked.grid or DEFAULT_EDGES)),
        repeats=asked.repeats,
        pairs=asked.pairs,
        kernels=asked.kernels,
        survey=asked.survey,
        seed=asked.seed,
    )
    measured = run_bench(
        asked.device, plan, lambda label, total: progress(label, total, quiet=as_json), command=_run_here
    )
    result = to_json(measured)
    if as_json:
        print_json(result, indent=2)
    else:
        Console(width=None if sys.stdout.isatty() else 180).print(describe(measured))
    return result, [f"{row['kernel']} at {row['grid']}^3" for row in result["kernels"] if not row["right"]]


def _run_here(arguments: Sequence[str]) -> None:
    """Run `sonarmap` with arguments in this process."""
    from sonarmap.tools.command.main import app

    app(arguments, standalone_mode=False)


def _show(result: Mapping[str, Any], picture: Path | None, page: Path | None) -> None:
    """Draw and write what was asked for."""
    from sonarmap.tools.lab.bench.output.page import write_page
    from sonarmap.tools.lab.bench.output.picture import draw_roofline

    if picture is not None:
        draw_roofline(picture, result)
        say(f"drawn: {printable(str(picture))}")
    if page is not None:
        write_page(page, result)
        say(f"written: the figures of {printable(str(page))}")


def _compared(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Say what differs; whether anything is worse."""
    from sonarmap.tools.lab.bench.output.compare import MARGIN, compare

    comparison = compare(old, new)
    for note in comparison.notes:
        say(note, "warning: ", "yellow")
    for change in comparison.changes:
        say(str(change), "worse: " if change.worse else "better: ", "bold red" if change.worse else "green")
    count, worse = len(comparison.changes), len(comparison.regressions)
    say(
        f"{comparison.compared} figures compared: {worse} worse, {count - worse} better, the others within the noise "
        f"(quartiles that overlap, or medians within {MARGIN:.0%})"
    )
    return bool(worse)
