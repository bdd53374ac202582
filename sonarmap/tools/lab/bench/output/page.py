"""The figures of docs/benchmarks.md, written from a result between two marks."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path

BEGIN = "<!-- from here on `sonarmap bench --page` writes -->"
END = "<!-- to here -->"


def write_page(path: Path, result: Mapping[str, Any]) -> None:
    """Replace what stands between the marks of a page by the figures of a result, as `as_json` gives it.

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


def figures(result: Mapping[str, Any]) -> str:
    """Words and tables in Markdown."""
    parts = [_machine(result)]
    for grid in dict.fromkeys(row["grid"] for row in result["kernels"]):
        parts += _kernel_tables(grid, [row for row in result["kernels"] if row["grid"] == grid])
    parts += _pair_tables(result["pairs"])
    if result.get("survey"):
        parts += _survey_table(result["survey"])
    return "\n".join(parts)


def _machine(result: Mapping[str, Any]) -> str:
    versions, rates = result["versions"], result["rates"]
    size = max(map(int, rates["copy"]))
    copy, in_place, read = (rates[way][str(size)] / 1e9 for way in ("copy", "in_place", "read"))
    named = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy", "pyfftw") if name in versions)
    loads = [load for load in result["load_average"] if load is not None]
    load = f", load average {loads[0]:.1f} before and {loads[-1]:.1f} after" if loads else ""
    words = (
        f"{result['device']['name']}, {result['cores']} cores ({result['device']['platform']}), {named}{load}. "
        f"Its memory copies {copy:.1f} GB/s, changes {in_place:.1f} GB/s in place and reads {read:.1f} GB/s; "
        f"it computes {result['flops'] / 1e9:.0f} GFLOP/s."
    )
    return fill(words, 128, break_long_words=False, break_on_hyphens=False) + "\n"


def _kernel_tables(grid: int, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    headings = ("kernel", "ms (quartiles)", "event ms", "twin / device", "pyfftw / device", "GFLOP/s", "GB/s")
    lines = [
        (
            row["kernel"],
            _milliseconds(row["device_seconds"]),
            "" if row["event_seconds"] is None else f"{1e3 * row['event_seconds']:.2f}",
            f"{row['ratio']:.1f}",
            next((f"{peer['ratio']:.2f}" for peer in row["peers"] if peer["library"] == "pyfftw"), ""),
            f"{row['flop_rate'] / 1e9:.1f}" if row["flops"] else "",
            f"{row['rate'] / 1e9:.1f}",
            f"{row['share_of_limit']:.0%}",
            f"{row['error']:.1e}",
        )
        for row in rows
    ]
    yield _table(f"Kernels at {grid}³", (*headings, "of limit", "difference"), lines)
    passes = [
        (row["kernel"], each["kernel"], f"{1e3 * each['event_seconds']:.2f}", f"{each['share_of_limit']:.0%}")
        for row in rows
        for each in row["passes"]
        if each["share_of_limit"] is not None
    ]
    if passes:
        yield _table(f"Passes of the transforms at {grid}³", ("kernel", "pass", "event ms", "of limit"), passes)


def _pair_tables(pairs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    if not pairs:
        return
    lines = []
    for row in pairs:
        register, prepare = row["register_seconds"], row["prepare_seconds"]
        count = register["count"]
        lines.append(
            (
                f"{row['grid']}³",
                _milliseconds(prepare),
                _milliseconds(register),
                f"{register['most_over_median']:.2f}",
                f"{row['right']} and {row['accepted']} of {count}",
                *(f"{row[name] / 2**30:.2f}" for name in ("peak_memory", "device_memory", "planned_memory")),
                "" if row["paper_seconds"] is None else f"{row['paper_seconds']:g} s",
            )
        )
    headings = ("grid", "prepare a scan, ms", "register a pair, ms", "most / median", "right and believed")
    memory = ("process GiB", "device GiB", "planned GiB")
    yield _table("Pairs", (*headings, *memory, "the paper (2010)"), lines)
    for row in pairs:
        yield _stage_table(row)


def _stage_table(row: Mapping[str, Any]) -> str:
    names = ("calls", "launches", "reads", "writes")
    total = {name: sum(stage[name] for stage in row["stages"]) for name in names}
    total |= {name: sum(stage[name] for stage in row["stages"]) for name in _SUMMED}
    lines = [_stage_cells(stage["name"], stage) for stage in row["stages"]]
    lines.append(_stage_cells("together", total))
    headings = ("stage", "calls", "ms", "device ms", "limit ms", "launches", "reads", "uploads", "arrays MB")
    return _table(f"Where a pair's time goes at {row['grid']}³, two scans prepared", headings, lines)


_SUMMED = ("own_seconds", "device_seconds", "limit_seconds", "array_bytes")


def _stage_cells(name: str, stage: Mapping[str, float]) -> tuple[str, ...]:
    return (
        name,
        f"{stage['calls']:.1f}",
        *(f"{1e3 * stage[each]:.1f}" for each in _SUMMED[:3]),
        *(f"{stage[each]:.1f}" for each in ("launches", "reads", "writes")),
        f"{stage['array_bytes'] / 1e6:.0f}",
    )


def _survey_table(survey: Mapping[str, Any]) -> Iterator[str]:
    scans, seconds = survey["scans"], survey["seconds"]
    stages = sorted(survey["stages"].items(), key=lambda stage: -stage[1])
    lines = [(name, f"{own:.2f}", f"{1e3 * own / scans:.1f}", f"{own / seconds:.1%}") for name, own in stages]
    lines.append(("together", f"{seconds:.2f}", f"{1e3 * seconds / scans:.1f}", "100%"))
    title = f"A survey of {scans} scans: {survey['pairs']} pairs, scans prepared {survey['prepared']} times"
    yield _table(title, ("stage", "s", "ms a scan", "share"), lines)


def _milliseconds(times: Mapping[str, float]) -> str:
    median, first, third = (f"{1e3 * times[name]:.3g}" for name in ("median", "first_quartile", "third_quartile"))
    return f"{median} ({first}..{third})"


def _table(title: str, headings: Sequence[str], lines: Iterable[tuple[str, ...]]) -> str:
    rows = [f"| {' | '.join(line)} |" for line in (headings, ["---"] * len(headings), *lines)]
    return "\n".join([f"**{title}**", "", *rows, ""])
