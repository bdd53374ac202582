"""A benchmark's result for people."""

from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.text import Text

from sonarmap.tools.lab.bench.rates import Rates
from sonarmap.tools.lab.bench.result import PAPER_SECONDS, BenchResult, KernelResult, PairResult, SurveyResult
from sonarmap.tools.lab.bench.timing import Times
from sonarmap.tools.lab.wide_table import WideTable

_RIGHT = frozenset(range(1, 20))  # of the columns: all but the names


def describe(result: BenchResult) -> RenderableType:
    """The machine, the kernels, the pairs, the survey."""
    parts: list[RenderableType] = [Text(line) for line in (*_head(result), *map(_pair_words, result.pairs))]
    for edge in dict.fromkeys(kernel.edge for kernel in result.kernels):
        rows = [kernel for kernel in result.kernels if kernel.edge == edge]
        parts += [Text(f"\nkernels at {edge}^3: medians [quartiles]"), _kernel_table(rows, result.rates)]
    if result.pairs:
        parts += [Text("\nsimulated pairs, seconds"), _pair_table(result.pairs)]
    for pair in result.pairs:
        parts += [Text(f"\nwhere a pair's time goes at {pair.edge}^3, with two scans prepared"), _stage_table(pair)]
    if result.survey:
        parts += [Text(f"\n{survey_words(result.survey)}"), _survey_table(result.survey)]
    return Group(*parts)


def survey_words(survey: SurveyResult) -> str:
    """The survey's time in a sentence."""
    return (
        f"a survey of {survey.scans} scans: {survey.seconds:.1f} s, {survey.seconds / survey.scans:.2f} s a scan; "
        f"{survey.pairs} pairs, scans prepared {survey.prepared} times, {survey.peak_memory / 2**30:.2f} GiB"
    )


def _pair_words(pair: PairResult) -> str:
    times = pair.register
    return (
        f"a prepared pair at {pair.edge}^3 is registered in {times.median:.3f} s (median of {times.count}); "
        f"{pair.right} of {times.count} are right"
    )


def _head(result: BenchResult) -> list[str]:
    machine, rates = result.machine, result.rates
    before, after = ("unknown" if load is None else f"{load:.1f}" for load in result.load)
    size = max(rates.best["copy"])
    in_place, reading = (gigabytes(rates.best[way][size]) for way in ("in_place", "read"))
    return [
        f"{machine.device} ({machine.platform})",
        f"twins: {machine.processor or 'unknown processor'}, {machine.cores} cores",
        f"the device copies {gigabytes(rates.copy_rate)} GB/s, changes in place {in_place}, reads {reading}, "
        f"and computes {rates.flops / 1e9:.0f} GFLOP/s; load average {before} before, {after} after",
    ]


def _kernel_table(kernels: Iterable[KernelResult], rates: Rates) -> WideTable:
    headings = ("device ms", "event ms", "compile s", "twin ms", "twin/device", "GFLOP/s", "GB/s", "of limit")
    headings = ("kernel", *headings, "difference", "twin")
    rows: list[list[str | Text]] = []
    for kernel in kernels:
        rows.append([kernel.name, *_kernel_cells(kernel, rates), kernel.twin_name])
        for library, times in kernel.peers.items():
            ratio = f"{times.median / kernel.device.median:.2f}"
            rows.append([f"  {library}", "", "", "", milliseconds(times), ratio, *[""] * 5])
        for name, traffic in kernel.launches.passes.items():
            seconds = kernel.launches.kernels[name]
            share = f"{rates.least_seconds(traffic) / seconds:.0%}"
            rate = gigabytes(traffic.moved / seconds)
            rows.append([f"  {name}", "", f"{1e3 * seconds:.3g}", *[""] * 4, rate, share, "", ""])
    return WideTable(headings, rows, _RIGHT - {len(headings) - 1})


def _kernel_cells(kernel: KernelResult, rates: Rates) -> list[str | Text]:
    event = kernel.launches.seconds
    right: list[str | Text] = [
        f"{kernel.ratio:.2f}",
        f"{kernel.flops / kernel.device.median / 1e9:.1f}" if kernel.flops else "",
        gigabytes(kernel.rate),
        f"{kernel.share_of_limit(rates):.0%}",
        f"{kernel.error:.1e}",
    ]
    wrong: list[str | Text] = ["-", "-", "-", "-", Text(f"WRONG {kernel.error:.1e}", "bold red")]
    return [
        milliseconds(kernel.device),
        "" if event is None else f"{1e3 * event:.3g}",
        f"{kernel.compile_seconds:.2f}",
        milliseconds(kernel.twin),
        *(right if kernel.right else wrong),
    ]


def _pair_table(pairs: Iterable[PairResult]) -> WideTable:
    headings = ("count", "median", "quartiles", "min", "max", "max/median", "paper", "right", "believed", "memory")
    headings = ("grid and step", *headings, "on device", "planned", "first")
    rows: list[list[str | Text]] = []
    for pair in pairs:
        paper = PAPER_SECONDS.get(pair.edge)
        outcome = [
            "" if paper is None else f"{paper:g}",
            f"{pair.right}/{pair.register.count}",
            f"{pair.accepted}/{pair.register.count}",
            *(f"{size / 2**30:.2f} GiB" for size in (pair.peak_memory, pair.device_memory, pair.planned_memory)),
            f"{pair.first_seconds:.1f}",
        ]
        rows.append([f"{pair.edge}^3 prepare a scan", *_seconds(pair.prepare), *[""] * 7])
        rows.append([f"{pair.edge}^3 register a pair", *_seconds(pair.register), *outcome])
    return WideTable(headings, rows, _RIGHT)


def _stage_table(pair: PairResult) -> WideTable:
    headings = ("stage", "calls", "ms", "of these own", "device ms", "launches", "reads", "uploads", "arrays MB")
    rows = [
        [
            stage.name,
            f"{stage.calls:.1f}",
            f"{1e3 * stage.seconds:.1f}",
            f"{1e3 * stage.own_seconds:.1f}",
            f"{1e3 * stage.device_seconds:.1f}",
            *(f"{count:.1f}" for count in (stage.launches, stage.reads, stage.writes)),
            f"{stage.array_bytes / 1e6:.0f}",
        ]
        for stage in pair.stages
    ]
    return WideTable(headings, rows, _RIGHT)


def _survey_table(survey: SurveyResult) -> WideTable:
    rows = [
        [name, f"{seconds:.2f}", f"{seconds / survey.seconds:.1%}", f"{1e3 * seconds / survey.scans:.1f}"]
        for name, seconds in sorted(survey.stages.items(), key=lambda stage: -stage[1])
    ]
    return WideTable(("stage", "s", "share", "ms a scan"), rows, _RIGHT)


def _seconds(times: Times) -> list[str]:
    return [
        str(times.count),
        f"{times.median:.3f}",
        f"[{times.first_quartile:.3f}..{times.third_quartile:.3f}]",
        f"{times.least:.3f}",
        f"{times.most:.3f}",
        f"{times.most_over_median:.2f}",
    ]


def milliseconds(times: Times) -> str:
    """Median and quartiles."""
    median, first, third = (f"{1e3 * s:.3g}" for s in (times.median, times.first_quartile, times.third_quartile))
    return f"{median} [{first}..{third}]"


def gigabytes(rate: float) -> str:
    """Of bytes per second."""
    return f"{rate / 1e9:.1f}"
