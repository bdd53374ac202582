"""A benchmark's result for people."""

from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tools.bench.result import PAPER_SECONDS, BenchResult, KernelResult, PairResult
from tools.bench.timing import Times


def describe(result: BenchResult) -> RenderableType:
    """The machine, the kernels, the pairs."""
    parts: list[RenderableType] = [Text(line) for line in _head(result)]
    for edge in dict.fromkeys(kernel.edge for kernel in result.kernels):
        rows = [kernel for kernel in result.kernels if kernel.edge == edge]
        parts += [
            Text(f"\nkernels at {edge}^3: medians [quartiles]"),
            _kernel_table(rows, result.copy_rate),
        ]
    if result.pairs:
        parts += [Text("\nsimulated pairs, seconds"), _pair_table(result.pairs)]
    return Group(*parts)


def _head(result: BenchResult) -> list[str]:
    machine = result.machine
    before, after = ("unknown" if load is None else f"{load:.1f}" for load in result.load)
    return [
        f"{machine.device} ({machine.platform})",
        f"twins: {machine.processor or 'unknown processor'}, {machine.cores} cores",
        f"the device copies {_gigabytes(result.copy_rate)} GB/s; load average {before} before, {after} after",
    ]


def _kernel_table(kernels: Iterable[KernelResult], copy_rate: float) -> Table:
    table = Table(box=None)
    table.add_column("kernel")
    for heading in ("device ms", "twin ms", "twin/device", "GB/s", "of copy", "difference"):
        table.add_column(heading, justify="right")
    table.add_column("twin")
    for kernel in kernels:
        verdict = Text(f"{kernel.error:.1e}") if kernel.right else Text(f"WRONG {kernel.error:.1e}", "bold red")
        table.add_row(
            kernel.name,
            _milliseconds(kernel.device),
            _milliseconds(kernel.twin),
            f"{kernel.ratio:.2f}" if kernel.right else "-",
            _gigabytes(kernel.rate) if kernel.right else "-",
            f"{kernel.rate / copy_rate:.0%}" if kernel.right else "-",
            verdict,
            kernel.twin_name,
        )
    return table


def _pair_table(pairs: Iterable[PairResult]) -> Table:
    table = Table(box=None)
    table.add_column("grid")
    table.add_column("step")
    headings = ("count", "median", "quartiles", "min", "max", "max/median", "paper", "right", "believed", "memory")
    for heading in headings:
        table.add_column(heading, justify="right")
    for pair in pairs:
        paper = PAPER_SECONDS.get(pair.edge)
        outcome = [
            "" if paper is None else f"{paper:g}",
            f"{pair.right}/{pair.register.count}",
            f"{pair.accepted}/{pair.register.count}",
            f"{pair.peak_memory / 2**30:.2f} GiB",
        ]
        table.add_row(f"{pair.edge}^3", "prepare a scan", *_seconds(pair.prepare), "", "", "", "")
        table.add_row("", "register a pair", *_seconds(pair.register), *outcome)
    return table


def _seconds(times: Times) -> list[str]:
    return [
        str(times.count),
        f"{times.median:.3f}",
        f"[{times.first_quartile:.3f}..{times.third_quartile:.3f}]",
        f"{times.least:.3f}",
        f"{times.most:.3f}",
        f"{times.most_over_median:.2f}",
    ]


def _milliseconds(times: Times) -> str:
    median, first, third = (f"{1e3 * s:.3g}" for s in (times.median, times.first_quartile, times.third_quartile))
    return f"{median} [{first}..{third}]"


def _gigabytes(rate: float) -> str:
    return f"{rate / 1e9:.1f}"
