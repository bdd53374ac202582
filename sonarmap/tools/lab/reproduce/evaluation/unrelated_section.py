"""Pairs that share nothing, in words and tables."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.beside import Measure, beside_table
from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import new_figure, save_figure, style
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import DASH, accepted, rate, where
from sonarmap.tools.lab.reproduce.table import Table

PICTURE = "unrelated.png"


def unrelated_section(rows: Sequence[Row], settings: PairSetSettings) -> Section:
    """Ours beside the others, then what every method accepts, in all and by scene."""
    methods = settings.compared.methods
    measure = Measure("accepted", lambda some: (accepted(some), some), "such pairs to be accepted", most=False)
    tables = [
        beside_table([measure.line(rows)] if where(rows, method=OURS) else []),
        Table(
            "What each method accepts, and the highest values it reports for any of the pairs",
            ("method", "accepted", "highest probability", "highest PSR", "largest overlap"),
            tuple(_line(method, where(rows, method=method)) for method in methods),
        ),
        _by_scene(rows, methods),
    ]
    return Section(
        title="Pairs that share nothing",
        introduction=_introduction(rows, settings),
        tables=tuple(tables),
        pictures={PICTURE: "What the methods report for pairs that share nothing. Crosses are accepted registrations."},
    )


def _line(method: str, rows: Sequence[Row]) -> tuple[str, ...]:
    highest = (_highest(rows, "probability", ".4f"), _highest(rows, "psr", ".1f"), _highest(rows, "overlap", ".2f"))
    return (method, rate(accepted(rows), rows), *highest)


def _highest(rows: Sequence[Row], key: str, form: str) -> str:
    values = [float(row[key]) for row in rows if not math.isnan(float(row[key]))]
    return format(max(values), form) if values else DASH


def _by_scene(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    scenes = list(dict.fromkeys(str(row["scene"]) for row in rows))
    lines = []
    for method in methods:
        by_scene = [where(rows, method=method, scene=scene) for scene in scenes]
        lines.append((method, *(f"{len(accepted(pairs))}/{len(pairs)}" for pairs in by_scene)))
    return Table("Accepted registrations, by the scene of the target", ("method", *scenes), tuple(lines))


def _introduction(rows: Sequence[Row], settings: PairSetSettings) -> str:
    count = len({row["number"] for row in rows})
    return (
        f"{count} pairs of scans that share nothing: their scenes are of different kinds, or of the same kind with "
        "different random plans. Both scans of a pair come from the same sensor, and the noise is that of the pairs "
        f"that overlap (set {settings.seed}). The grid has {settings.edge} voxels along each edge; their size is "
        f"chosen from the two scans. Every registration is wrong, so none should be accepted. {settings.compared.words}"
    )


_MARKS = {"psr": "peak-to-sidelobe ratio", "probability": "reported probability", "overlap": "estimated overlap"}


def draw_unrelated(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG: one panel for each mark, a column of points for each method that has it."""
    figure = new_figure(11.5, 4.2)
    for axes, (key, label) in zip(figure.subplots(1, len(_MARKS)), _MARKS.items(), strict=True):
        rated = [row for row in rows if not math.isnan(float(row[key]))]
        methods = list(dict.fromkeys(str(row["method"]) for row in rated))
        for column, method in enumerate(methods):
            some = where(rated, method=method)
            beside = 0.3 * np.linspace(-1, 1, len(some))  # in the order of the pairs, so that all are seen
            for is_accepted, mark, size in ((False, ".", 3), (True, "x", 7)):
                held = [
                    (column + x, row[key])
                    for x, row in zip(beside, some, strict=True)
                    if row["accepted"] is is_accepted
                ]
                appearance = style(method) | {"linewidth": 0}
                axes.plot(*np.array(held, float).reshape(-1, 2).T, mark, markersize=size, **appearance)
        axes.set_xticks(range(len(methods)), methods, rotation=40, ha="right", fontsize=8)
        axes.set_title(label if methods else f"{label}: by no method", fontsize=10)
        axes.grid(alpha=0.3)
    save_figure(figure, path)
