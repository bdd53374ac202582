"""`sonarmap bench`: speed of the kernels and of registration on this machine."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonarmap.tools.command.method import check_seed
from sonarmap.tools.command.option import MEASUREMENT, OUTPUT, DeviceOption, JsonOption
from sonarmap.tools.command.terminal import print_json, progress

if TYPE_CHECKING:
    from sonarmap.tools.lab.bench.run import BenchPlan

DEFAULT_EDGES = (64, 128, 256)


def command(
    grid: list[int] | None = MEASUREMENT.option(
        "N", "Voxels per edge, 16..512: even products of 2, 3 and 5; may be repeated.", shown="64, 128 and 256"
    ),
    repeats: int = MEASUREMENT.option("R", "Number of timed runs of each kernel.", 15, min=1),
    pairs: int = MEASUREMENT.option("P", "Simulated pairs to register; 0 is none.", 20, min=0),
    kernels: bool = MEASUREMENT.flag("--kernels/--no-kernels", "Time the kernels.", True, rare=True),
    survey: int = MEASUREMENT.option(
        "N", "Also map a simulated survey of N scans, from files to files; 0 is none.", 0, min=0
    ),
    out: Path | None = OUTPUT.option("FILE", "Also write the result as JSON: one file to send.", None, "-o", "--out"),
    device: DeviceOption = None,
    seed: int = MEASUREMENT.option(
        "S", "Seed of the pairs. The same seed gives the same pairs.", 0, rare=True, callback=check_seed
    ),
    as_json: JsonOption = False,
) -> None:
    """Time the kernels and the registration of pairs.

    Transforms are also timed by pyfftw and pyvkfft, if these are installed.
    """
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.tables import write_json
    from sonarmap.tools.lab.bench.run import BenchPlan

    if out is not None:
        require_writable(out.parent)
    plan = BenchPlan(
        edges=list(dict.fromkeys(grid or DEFAULT_EDGES)),
        repeats=repeats,
        pairs=pairs,
        kernels=kernels,
        survey=survey,
        seed=seed,
    )
    result = _run(plan, device, as_json)
    if out is not None:
        write_json(out, result)


def _run(plan: "BenchPlan", device: str | None, as_json: bool) -> dict[str, Any]:
    """Run the benchmark and print it; return the result as JSON's types."""
    from rich.console import Console

    from sonarmap.tools.files.writers.tables import to_json
    from sonarmap.tools.lab.bench.run import run_bench
    from sonarmap.tools.lab.bench.table import describe

    measured = run_bench(device, plan, lambda label, total: progress(label, total, quiet=as_json), command=_run_here)
    result = to_json(measured)
    if as_json:
        print_json(result, indent=2)
    else:
        Console(width=None if sys.stdout.isatty() else 180).print(describe(measured))
    return result


def _run_here(arguments: Sequence[str]) -> None:
    """Run `sonarmap` with the arguments in this process."""
    from sonarmap.tools.command.main import app

    app(arguments, standalone_mode=False)
