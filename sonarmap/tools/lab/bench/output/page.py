"""The figures of docs/benchmarks.md, written from a result between two marks."""

from collections.abc import Iterable
from pathlib import Path
from textwrap import fill

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.bench.output.columns import (
    RATES,
    REQUESTS,
    Columns,
    Row,
    cells,
    milliseconds,
    number,
    of_memory,
    survey_rows,
)

BEGIN = "<!-- from here on `sonarmap bench --page` writes -->"
END = "<!-- to here -->"


def write_page(path: Path, result: Row) -> None:
    """Replace what stands between the marks of a page by the figures of a result.

    Raises:
        InputError: the page cannot be read or written, or does not hold both marks once.
    """
    try:
        text = read_content(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read {path}: {error}") from error
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise InputError(f"{path} does not hold the lines '{BEGIN}' and '{END}', once each; add them where they belong")
    before, rest = text.split(BEGIN)
    with atomic_path(path) as temporary:
        temporary.write_text(f"{before}{BEGIN}\n\n{figures(result)}\n{END}{rest.split(END)[1]}", encoding="utf-8")


def figures(result: Row) -> str:
    """Words and tables in Markdown."""
    parts = [_machine(result)]
    for grid in dict.fromkeys(row["grid"] for row in result["kernels"]):
        rows = [row for row in result["kernels"] if row["grid"] == grid]
        passes = [each | {"of": row["kernel"]} for row in rows for each in row["passes"] if each["bytes"]]
        parts.append(_table(f"Kernels at {grid}³", _KERNEL, rows))
        if passes:
            parts.append(_table(f"Passes of the transforms at {grid}³", _PASS, passes))
    if result["pairs"]:
        parts.append(_table("Pairs", _PAIR, result["pairs"]))
    for row in result["pairs"]:
        stages = row["stages"]
        total = {name: sum(stage[name] for stage in stages) for name in _SUMMED} | {"name": "together"}
        title = f"Where a pair's time goes at {row['grid']}³, two scans prepared"
        parts.append(_table(title, _STAGE, [*stages, total]))
    if survey := result.get("survey"):
        scans, seconds = survey["scans"], survey["seconds"]
        title = f"A survey of {scans} scans: {survey['pairs']} pairs, scans prepared {survey['prepared']} times"
        total = {"stage": "together", "s": seconds, "scan": seconds / scans, "share": None}
        parts.append(_table(title, _SURVEY, [*survey_rows(survey), total]))
    return "\n".join(parts)


def _machine(result: Row) -> str:
    versions, rates = result["versions"], result["rates"]
    size = max(map(int, rates["copy"]))
    copy, in_place, read = (rates[access][str(size)] / 1e9 for access in ("copy", "in_place", "read"))
    named = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy", "pyfftw") if name in versions)
    loads = [load for load in result["load_average"] if load is not None]
    load = f", load average {loads[0]:.1f} before and {loads[-1]:.1f} after" if loads else ""
    words = (
        f"{result['device']['name']}, {result['cores']} cores ({result['device']['platform']}), {named}{load}. "
        f"Its memory copies {copy:.1f} GB/s, changes {in_place:.1f} GB/s in place and reads {read:.1f} GB/s; "
        f"it computes {result['flops'] / 1e9:.0f} GFLOP/s."
    )
    return fill(words, 128, break_long_words=False, break_on_hyphens=False) + "\n"


_MILLISECONDS = "{} ({}..{})"
_KERNEL: Columns = {
    "kernel": lambda row: row["kernel"],
    "ms (quartiles)": milliseconds("device_seconds", _MILLISECONDS),
    "event ms": number("event_seconds", ".2f", 1e3),
    "twin / device": number("ratio", ".1f"),
    "pyfftw / device": lambda row: next(
        (f"{peer['ratio']:.2f}" for peer in row["peers"] if peer["library"] == "pyfftw"), ""
    ),
    **RATES,
}
_PASS: Columns = {
    "kernel": lambda row: row["of"],
    "pass": lambda row: row["kernel"],
    "event ms": number("event_seconds", ".2f", 1e3),
    "of limit": number("share_of_limit", ".0%"),
}
_PAIR: Columns = {
    "grid": lambda row: f"{row['grid']}³",
    "prepare a scan, ms": milliseconds("prepare_seconds", _MILLISECONDS),
    "register a pair, ms": milliseconds("register_seconds", _MILLISECONDS),
    "most / median": lambda row: f"{row['register_seconds']['most_over_median']:.2f}",
    "right and believed": lambda row: f"{row['right']} and {row['accepted']} of {row['register_seconds']['count']}",
    "process GiB": of_memory("peak_memory"),
    "device GiB": of_memory("device_memory"),
    "planned GiB": of_memory("planned_memory"),
    "the paper (2010)": lambda row: "" if row["paper_seconds"] is None else f"{row['paper_seconds']:g} s",
}
_SUMMED = ("calls", "own_seconds", "device_seconds", "limit_seconds", "launches", "reads", "writes", "array_bytes")
_STAGE: Columns = {
    "stage": lambda row: row["name"],
    "calls": number("calls", ".1f"),
    "ms": number("own_seconds", ".1f", 1e3),
    "device ms": number("device_seconds", ".1f", 1e3),
    "limit ms": number("limit_seconds", ".1f", 1e3),
    **REQUESTS,
}
_SURVEY: Columns = {
    "stage": lambda row: row["stage"],
    "s": number("s", ".2f"),
    "ms a scan": number("scan", ".1f", 1e3),
    "share": lambda row: "100%" if row["share"] is None else f"{row['share']:.1%}",
}


def _table(title: str, columns: Columns, rows: Iterable[Row]) -> str:
    lines = [f"| {' | '.join(line)} |" for line in ([*columns], ["---"] * len(columns), *cells(columns, rows))]
    return "\n".join([f"**{title}**", "", *lines, ""])
