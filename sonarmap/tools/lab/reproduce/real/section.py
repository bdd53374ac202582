"""The experiment on real scans in words."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.beside import Measure, beside_table
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import draw_bars, legend_beside, new_figure, save_figure, style
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.real.settings import RealSettings
from sonarmap.tools.lab.reproduce.rows import (
    DASH,
    accepted,
    column,
    distinct,
    grouped,
    middle,
    number,
    refused,
    right,
    variants,
    where,
    wrong,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of


def real_section(rows: Sequence[Row], seconds: Sequence[Row], settings: RealSettings) -> Section:
    """Words, tables and pictures from all rows."""
    return Section(
        title="Pairs of real scans",
        tables=(beside_others(rows), result_table(rows), pair_table(rows)),
        times=(time_table(seconds),),
        pictures={
            OUTCOMES: "Right and wrong registrations by set, believed (dark) or not (light).",
            ERRORS: f"Errors of all registrations; what lies within the lines is right. `{OURS}` stands out.",
        },
    )


ALL_SETS = "all sets"


def beside_others(rows: Sequence[Row]) -> Table:
    """Ours with everything that it was given, beside the others with nothing but the points."""
    others = [row for row in where(rows, known="nothing") if row["method"] != OURS]
    lines = []
    for known in distinct(where(rows, method=OURS), "known"):
        some, words = [*where(rows, method=OURS, known=known), *others], f"known: {known}"
        good = Measure(f"right and believed, {words}", lambda r: (accepted(right(r)), r), "to be right and believed")
        bad = f"believed though wrong, {words}"
        false = Measure(bad, lambda r: (accepted(wrong(r)), r), "to be believed though wrong", most=False)
        lines += [good.line(some), false.line(some)]
    return beside_table(lines)


def result_table(rows: Sequence[Row]) -> Table:
    """Right, believed, both, and the errors of what is right, for every set and method."""
    return table_of(
        "Right and believed by set and method",
        ("set", "method", "known"),
        _by_set(rows),
        {
            "registrations": lambda some: str(len(some)),
            "right": lambda some: str(len(right(some))),
            "believed": lambda some: str(len(accepted(some))),
            "wrong and believed": lambda some: str(len(accepted(wrong(some)))),
            "median error of the right [°]": lambda some: number(middle(right(some), "rotation_deg"), 3),
            "the same [m]": lambda some: number(middle(right(some), "translation_m"), 3),
        },
    )


def pair_table(rows: Sequence[Row]) -> Table:
    """Every pair by every method: its error, and whether it is believed."""
    columns = {
        method if known == "nothing" else f"{method}, known: {known}": lambda some, method=method, known=known: _cell(
            where(some, method=method, known=known)
        )
        for method, known in variants(rows, "known")
    }
    sets = distinct(rows, "set")
    pairs = {
        f"{name} {pair}": some for name in sets for (pair,), some in grouped(where(rows, set=name), "pair").items()
    }
    title = (
        "Every pair: error of what is right [°, m], and whether it is believed; of several draws, how many are right"
    )
    return table_of(title, ("pair",), [((name,), some) for name, some in pairs.items()], columns)


def time_table(seconds: Sequence[Row]) -> Table:
    """How long a pair takes."""
    return table_of(
        "Preparing both scans and registering them; the first pair of a process also loads and compiles the code",
        ("set", "method", "known"),
        _by_set(seconds),
        {
            "registrations": lambda some: str(len(some)),
            "median [s]": lambda some: f"{middle(some, 'seconds'):.2f}",
            "max [s]": lambda some: f"{max(column(some, 'seconds')):.2f}",
        },
    )


def _cell(rows: Sequence[Row]) -> str:
    """One registration, or how many of several are right and believed."""
    if len(rows) != 1:
        good = f"{len(right(rows))} of {len(rows)}; {len(accepted(rows))} believed"
        return good if rows else DASH
    (row,) = rows
    error = f"{float(row['rotation_deg']):.2f}, {float(row['translation_m']):.3f}" if row["right"] else "wrong"
    return f"{error}; believed" if row["accepted"] else error


def _by_set(rows: Sequence[Row]) -> list[tuple[tuple[str, str, str], list[Row]]]:
    """The rows of every set and, where there are several, of all, by method and what was known."""
    names = distinct(rows, "set")
    sets = [(name, where(rows, set=name)) for name in names] + ([(ALL_SETS, list(rows))] if len(names) > 1 else [])
    return [
        ((name, method, known), where(some, method=method, known=known))
        for name, some in sets
        for method, known in variants(some, "known")
    ]


OUTCOMES, ERRORS = "real.png", "real-errors.png"
_LEAST_DEG, _LEAST_VOXELS = 0.01, 0.01  # smaller errors are drawn there


def draw_real(folder: Path, rows: Sequence[Row], settings: RealSettings) -> None:
    """Write outcomes by set and method, and the errors of all pairs."""
    _draw_outcomes(folder / OUTCOMES, rows, list(settings.sets))
    _draw_errors(folder / ERRORS, rows, settings.compared.methods)


def _draw_outcomes(path: Path, rows: Sequence[Row], sets: Sequence[str]) -> None:
    """A panel for every set, a bar for every method."""
    bars = variants(rows, "known")
    figure = new_figure(2.6 * len(sets) + 3.4, 0.32 * len(bars) + 1.4)
    panels = figure.subplots(1, len(sets), squeeze=False, sharey=True)[0]
    for axes, name in zip(panels, sets, strict=True):
        draw_bars(axes, [where(rows, set=name, method=method, known=known) for method, known in bars])
        axes.set(title=name, xlabel="share of registrations", xlim=(0, 1))
    labels = [method if known == "nothing" else f"{method}, {known} known" for method, known in bars]
    panels[0].set_yticks(range(len(bars)), labels, fontsize=8)
    panels[0].invert_yaxis()
    legend_beside(panels[-1])
    save_figure(figure, path)


def _draw_errors(path: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """Rotation against translation of every registration, both on a logarithmic scale."""
    figure = new_figure(7.2, 4.6)
    axes = figure.subplots()
    for method in methods:
        color, zorder = (style(method)[key] for key in ("color", "zorder"))
        some, size = where(rows, method=method), 46 if method == OURS else 20
        for shown, face, label in ((accepted(some), color, method), (refused(some), "none", None)):
            x = np.maximum(column(shown, "translation_voxels"), _LEAST_VOXELS)
            y = np.maximum(column(shown, "rotation_deg"), _LEAST_DEG)
            axes.scatter(x, y, s=size, facecolors=face, edgecolors=color, zorder=zorder, label=label)
    axes.axhline(RIGHT_DEG, color="k", linewidth=0.8, linestyle="--")
    axes.axvline(RIGHT_VOXELS, color="k", linewidth=0.8, linestyle="--")
    axes.set(xscale="log", yscale="log", xlabel="translation error [voxels]", ylabel="rotation error [degrees]")
    axes.set_title("filled: believed", fontsize=10)
    axes.grid(alpha=0.3)
    legend_beside(axes)
    save_figure(figure, path)
