"""The columns of a result's tables, each a heading and how a row's cell is made, for the terminal and the page."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

Row = Mapping[str, Any]
Columns = Mapping[str, Callable[[Row], str]]


def number(name: str, form: str, scale: float = 1) -> Callable[[Row], str]:
    """A cell with a number of the row in a format, "" where it is None."""
    return lambda row: "" if row[name] is None else f"{scale * row[name]:{form}}"


def milliseconds(name: str, form: str = "{} [{}..{}]") -> Callable[[Row], str]:
    """A cell with median and quartiles of the row's times."""
    parts = ("median", "first_quartile", "third_quartile")
    return lambda row: form.format(*(f"{1e3 * row[name][part]:.3g}" for part in parts))


def cells(columns: Columns, rows: Iterable[Row]) -> list[list[str]]:
    """The rows' cells."""
    return [[make(row) for make in columns.values()] for row in rows]


def of_memory(name: str, form: str = "{}") -> Callable[[Row], str]:
    """A cell with a memory of the row in GiB."""
    return lambda row: form.format(f"{row[name] / 2**30:.2f}")


# How fast a kernel is.
RATES: Columns = {
    "GFLOP/s": lambda row: f"{row['flop_rate'] / 1e9:.1f}" if row["flops"] else "",
    "GB/s": number("rate", ".1f", 1e-9),
    "of limit": number("share_of_limit", ".0%"),
    "difference": number("error", ".1e"),
}
# What a stage asks of the device.
REQUESTS: Columns = {
    "launches": number("launches", ".1f"),
    "reads": number("reads", ".1f"),
    "uploads": number("writes", ".1f"),
    "arrays MB": number("array_bytes", ".0f", 1e-6),
}


def survey_rows(survey: Row) -> Iterator[Row]:
    """The stages of a survey, the longest first."""
    for name, seconds in sorted(survey["stages"].items(), key=lambda stage: -stage[1]):
        yield {"stage": name, "s": seconds, "share": seconds / survey["seconds"], "scan": seconds / survey["scans"]}
