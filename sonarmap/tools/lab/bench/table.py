"""Formats the result of a benchmark as tables for the terminal."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from sonarmap.tools.lab.terminal import plain_table

Row = Mapping[str, Any]
Columns = Mapping[str, Callable[[Row], str]]  # heading -> the cell of a row


def number(name: str, form: str = "", scale: float = 1) -> Callable[[Row], str]:
    """A cell with the number `name` of a row times `scale`, in a format; "" for None."""
    return lambda row: "" if row[name] is None else f"{scale * row[name]:{form}}"


def milliseconds(name: str) -> Callable[[Row], str]:
    """A cell with the median and quartiles of times of a row."""
    parts = ("median", "first_quartile", "third_quartile")
    return lambda row: "{} [{}..{}]".format(*(f"{1e3 * row[name][part]:.3g}" for part in parts))


def gibibytes(name: str) -> Callable[[Row], str]:
    """A cell with an amount of memory of a row."""
    return lambda row: f"{row[name] / 2**30:.2f} GiB"


def cells(columns: Columns, row: Row) -> list[str]:
    """The row's cells."""
    return [make(row) for make in columns.values()]


_KERNEL: Columns = {
    "kernel": lambda row: row["kernel"],
    "ms": milliseconds("device_seconds"),
    "event ms": number("event_seconds", ".3g", 1e3),
    "compile s": number("compile_seconds", ".2f"),
    "GB/s": number("rate", ".1f", 1e-9),
    "of copying": number("rate_over_copy_rate", ".0%"),
}
_PAIR_TIMES: Columns = {
    "count": number("count"),
    "median": number("median", ".3f"),
    "quartiles": lambda times: f"[{times['first_quartile']:.3f}..{times['third_quartile']:.3f}]",
    "min": number("least", ".3f"),
    "max": number("most", ".3f"),
    "max/median": number("most_over_median", ".2f"),
}
_PAIR: Columns = {
    "paper": number("paper_seconds", "g"),
    "right": lambda row: f"{row['right']}/{row['register_seconds']['count']}",
    "believed": lambda row: f"{row['accepted']}/{row['register_seconds']['count']}",
    "memory": gibibytes("peak_memory"),
    "on device": gibibytes("device_memory"),
    "planned": gibibytes("planned_memory"),
    "first": number("first_seconds", ".1f"),
}
_STAGE: Columns = {
    "stage": lambda row: row["name"],
    "calls": number("calls", ".1f"),
    "ms": number("seconds", ".1f", 1e3),
    "of these own": number("own_seconds", ".1f", 1e3),
    "device ms": number("device_seconds", ".1f", 1e3),
    "launches": number("launches", ".1f"),
    "reads": number("reads", ".1f"),
    "uploads": number("writes", ".1f"),
    "arrays MB": number("array_bytes", ".0f", 1e-6),
}


def describe(result: Row) -> RenderableType:
    """Text and tables of the machine, kernels, pairs and survey in a result of `run_bench`."""
    pairs, survey = result["pairs"], result["survey"]
    parts: list[RenderableType] = [Text(line) for line in (*_head(result), *map(_pair_words, pairs))]
    for grid in dict.fromkeys(row["grid"] for row in result["kernels"]):
        rows = [row for row in result["kernels"] if row["grid"] == grid]
        lines = [line for row in rows for line in _kernel_lines(row)]
        parts += [Text(f"\nkernels at {grid}^3: medians [quartiles]")]
        parts += [plain_table([*_KERNEL, "peer/device"], lines)]
    if pairs:
        lines = [line for row in pairs for line in _pair_lines(row)]
        headings = ("grid and step", *_PAIR_TIMES, *_PAIR)
        parts += [Text("\nsimulated pairs, seconds"), plain_table(headings, lines)]
    for row in pairs:
        parts += [Text(f"\nwhere a pair's time goes at {row['grid']}^3, with two scans prepared")]
        parts += [plain_table([*_STAGE], [cells(_STAGE, stage) for stage in row["stages"]])]
    if survey:
        words = (
            f"a survey of {survey['scans']} scans: {survey['seconds']:.1f} s, "
            f"{survey['seconds'] / survey['scans']:.2f} s a scan; {survey['pairs']} pairs, "
            f"scans prepared {survey['prepared']} times, {survey['peak_memory'] / 2**30:.2f} GiB"
        )
        parts += [Text(f"\n{words}"), plain_table(("stage", "s", "share", "ms a scan"), _survey_lines(survey))]
    return Group(*parts)


def _head(result: Row) -> list[str]:
    before, after = ("unknown" if load is None else f"{load:.1f}" for load in result["load_average"])
    return [
        f"{result['device']['name']} ({result['device']['platform']})",
        f"host: {result['processor'] or 'unknown processor'}, {result['cores']} cores",
        f"the device copies {result['copy_rate'] / 1e9:.1f} GB/s; load average {before} before, {after} after",
    ]


def _pair_words(row: Row) -> str:
    times = row["register_seconds"]
    return (
        f"a prepared pair at {row['grid']}^3 is registered in {times['median']:.3f} s (median of {times['count']}); "
        f"{row['right']} of {times['count']} are right"
    )


def _kernel_lines(row: Row) -> Iterator[list[str]]:
    """The line of the kernel, and one per peer."""
    yield [*cells(_KERNEL, row), ""]
    for peer in row["peers"]:
        yield [f"  {peer['library']}", milliseconds("seconds")(peer), "", "", "", "", f"{peer['ratio']:.2f}"]


def _pair_lines(row: Row) -> Iterator[list[str]]:
    grid = f"{row['grid']}^3"
    yield [f"{grid} prepare a scan", *cells(_PAIR_TIMES, row["prepare_seconds"]), *[""] * len(_PAIR)]
    yield [f"{grid} register a pair", *cells(_PAIR_TIMES, row["register_seconds"]), *cells(_PAIR, row)]


def _survey_lines(survey: Row) -> Iterator[list[str]]:
    """A line per stage, the longest first."""
    for name, seconds in sorted(survey["stages"].items(), key=lambda stage: -stage[1]):
        share, scan = seconds / survey["seconds"], seconds / survey["scans"]
        yield [name, f"{seconds:.2f}", f"{share:.1%}", f"{1e3 * scan:.1f}"]
