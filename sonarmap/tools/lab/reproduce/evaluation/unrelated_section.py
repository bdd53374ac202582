"""Pairs that share nothing, in words and tables."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.beside import Measure, beside_table
from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import new_figure, save_figure, style
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    accepted,
    by_method,
    column,
    distinct,
    for_each,
    known,
    number,
    rate,
    where,
)
from sonarmap.tools.lab.reproduce.table import table_of

PICTURE = "unrelated.png"


def unrelated_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: PairSetSettings) -> Section:
    """Ours beside the others, then what every method accepts, in all and by scene."""
    methods = by_method(rows, settings.compared.methods)
    measure = Measure("accepted", lambda some: (accepted(some), some), "such pairs to be accepted", most=False)
    highest = {
        "accepted": lambda some: rate(accepted(some), some),
        "highest probability": partial(_highest, "probability", 4),
        "highest PSR": partial(_highest, "psr", 1),
        "largest overlap": partial(_highest, "overlap", 2),
    }
    title = "What each method accepts, and the highest values it reports for any of the pairs"
    by_scene = for_each("scene", distinct(rows, "scene"), lambda some: f"{len(accepted(some))}/{len(some)}")
    return Section(
        title="Pairs that share nothing",
        tables=(
            beside_table([measure.line(rows)] if where(rows, method=OURS) else []),
            table_of(title, ("method",), methods, highest),
            table_of("Accepted registrations, by the scene of the target", ("method",), methods, by_scene),
        ),
        pictures={PICTURE: "What the methods report for pairs that share nothing. Crosses are accepted registrations."},
    )


def _highest(key: str, digits: int, rows: Sequence[Row]) -> str:
    return number(max(column(known(rows, key), key), default=math.nan), digits)


_MARKS = {"psr": "peak-to-sidelobe ratio", "probability": "reported probability", "overlap": "estimated overlap"}


def draw_unrelated(folder: Path, rows: Sequence[Row], _settings: PairSetSettings) -> None:
    """Write a PNG: one panel for each mark, a column of points for each method that has it."""
    figure = new_figure(11.5, 4.2)
    for axes, (key, label) in zip(figure.subplots(1, len(_MARKS)), _MARKS.items(), strict=True):
        rated = known(rows, key)
        methods = distinct(rated, "method")
        for place, method in enumerate(methods):
            some = where(rated, method=method)
            x = place + 0.3 * np.linspace(-1, 1, len(some))  # in the order of the pairs, so that all are seen
            crossed = np.array([bool(row["accepted"]) for row in some])
            for chosen, mark, size in ((~crossed, ".", 3), (crossed, "x", 7)):
                appearance = style(method) | {"linewidth": 0, "markersize": size}
                axes.plot(x[chosen], column(some, key)[chosen], mark, **appearance)
        axes.set_xticks(range(len(methods)), methods, rotation=40, ha="right", fontsize=8)
        axes.set_title(label if methods else f"{label}: by no method", fontsize=10)
        axes.grid(alpha=0.3)
    save_figure(figure, folder / PICTURE)
