"""Rows of the experiment on real scans in tables."""

from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import NOTHING, accepted, middle, right, wrong
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict

ALL_SETS = "all sets"


def verdict_table(rows: Sequence[Row]) -> Table:
    """What is wanted of ours: every pair right and believed, nothing wrong believed."""
    lines: list[tuple[str, ...]] = []
    for known in _distinct(where(rows, method=OURS), "known"):
        some = where(rows, method=OURS, known=known)
        good, false = accepted(right(some)), accepted(wrong(some))
        words = f"known: {known}"
        lines.append(
            (f"right and believed, {words}", "all", f"{len(good)} of {len(some)}", verdict(len(good) == len(some)))
        )
        lines.append((f"believed though wrong, {words}", "none", f"{len(false)} of {len(some)}", verdict(not false)))
    return Table(f"What is wanted of `{OURS}`", ("measure", "required", "ours", "verdict"), tuple(lines))


def result_table(rows: Sequence[Row]) -> Table:
    """Right, believed, both, and the errors of what is right, for every set and method."""
    lines = []
    for name, of_set in _by_set(rows):
        for method, known in variants(of_set):
            some = where(of_set, method=method, known=known)
            good = right(some)
            counts = (len(some), len(good), len(accepted(some)), len(accepted(wrong(some))))
            medians = (f"{middle(good, key):.3f}" if good else NOTHING for key in ("rotation_deg", "translation_m"))
            lines.append((name, method, known, *map(str, counts), *medians))
    headings = ("set", "method", "known", "registrations", "right", "believed", "wrong and believed")
    errors = ("median error of the right [°]", "the same [m]")
    return Table("Right and believed by set and method", (*headings, *errors), tuple(lines))


def pair_table(rows: Sequence[Row]) -> Table:
    """Every pair by every method: its error, and whether it is believed."""
    columns = variants(rows)
    lines = []
    for name in _distinct(rows, "set"):
        for pair in _distinct(where(rows, set=name), "pair"):
            some = where(rows, set=name, pair=pair)
            cells = (where(some, method=method, known=known) for method, known in columns)
            lines.append((f"{name} {pair}", *map(_cell, cells)))
    headings = (method if known == "nothing" else f"{method}, known: {known}" for method, known in columns)
    return Table(
        "Every pair: error of what is right [°, m], and whether it is believed; of several draws, how many are right",
        ("pair", *headings),
        tuple(lines),
    )


def time_table(seconds: Sequence[Row]) -> Table:
    """How long a pair takes."""
    lines = []
    for name, of_set in _by_set(seconds):
        for method, known in variants(of_set):
            some = where(of_set, method=method, known=known)
            times = [float(row["seconds"]) for row in some]
            lines.append((name, method, known, str(len(some)), f"{middle(some, 'seconds'):.2f}", f"{max(times):.2f}"))
    title = "Preparing both scans and registering them; the first pair of a process also loads and compiles the code"
    return Table(title, ("set", "method", "known", "registrations", "median [s]", "max [s]"), tuple(lines))


def _cell(rows: Sequence[Row]) -> str:
    """One registration, or how many of several are right and believed."""
    if len(rows) != 1:
        good = f"{len(right(rows))} of {len(rows)}; {len(accepted(rows))} believed"
        return good if rows else NOTHING
    (row,) = rows
    error = f"{float(row['rotation_deg']):.2f}, {float(row['translation_m']):.3f}" if row["right"] else "wrong"
    return f"{error}; believed" if row["accepted"] else error


def _by_set(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """The rows of every set and, where there are several, of all."""
    names = _distinct(rows, "set")
    total = [(ALL_SETS, list(rows))] if len(names) > 1 else []
    return [*((name, where(rows, set=name)) for name in names), *total]


def variants(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """The methods, each with everything that was known, in the order of the rows, those of one method together."""
    pairs = list(dict.fromkeys((str(row["method"]), str(row["known"])) for row in rows))
    methods = list(dict.fromkeys(method for method, _ in pairs))
    return sorted(pairs, key=lambda pair: methods.index(pair[0]))


def _distinct(rows: Sequence[Row], key: str) -> list[str]:
    return list(dict.fromkeys(str(row[key]) for row in rows))
