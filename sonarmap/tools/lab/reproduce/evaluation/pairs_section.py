"""The pair set in words, tables and figures."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from sonarmap.tools.lab.reproduce.beside import Line, Measure, beside_table, others_of
from sonarmap.tools.lab.reproduce.calibration_tables import (
    FREEDOM,
    OVERLAPS,
    CovarianceCheck,
    calibration,
    calibration_table,
    reliability,
    reliability_table,
    shared,
)
from sonarmap.tools.lab.reproduce.evaluation.settings import PairsSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import draw_rates, draw_reliability, legend_beside, new_figure, save_figure
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    accepted,
    by_method,
    column,
    distinct,
    for_each,
    in_percent,
    known,
    middle,
    percent,
    rate,
    refused,
    right,
    where,
    wilson,
    wrong,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of

OVERLAP, NEES, PROBABILITY = "pairs-overlap.png", "pairs-nees.png", "pairs-probability.png"
CLEAR = 0.4  # of the points in common: pairs that share more should be accepted
_TURNS = {"yaw": "any yaw, tilt up to 35°", "any": "any rotation"}
_TENTHS = tuple(k / 10 for k in range(11))
_FARTHEST = 30.0  # normalized squared errors beyond it stand in the last bar


def pairs_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: PairsSettings) -> Section:
    """Ours beside the others, then every method's success and acceptance, then the calibration of ours."""
    methods = settings.compared.methods
    yaw, free = where(rows, turn="yaw"), where(rows, turn="any")
    tables = [
        overlap_table(yaw, methods, "Right registrations by overlap: any yaw, tilt up to 35 degrees"),
        overlap_table(free, methods, "Right registrations by overlap: any rotation"),
        trust_table(yaw, methods, "What each method accepts: any yaw, tilt up to 35 degrees"),
        trust_table(free, methods, "What each method accepts: any rotation"),
        scene_table(yaw, methods),
        accuracy_table(yaw, methods),
        calibration_table(yaw, free, methods),
        reliability_table(yaw, free),
    ]
    pictures = {
        OVERLAP: f"Share of right registrations against the overlap. The band is the 95 % interval of `{OURS}`."
    }
    if OURS in methods:
        pictures |= {
            NEES: f"Normalized squared errors of the right registrations of `{OURS}`, and the chi-squared density.",
            PROBABILITY: f"How often `{OURS}` is right against the probability it reports. The numbers are counts of "
            "registrations.",
        }
    return Section(
        title="Pairs of every overlap",
        tables=(beside_others(yaw, free), *(table for table in tables if table.rows)),
        pictures=pictures,
    )


def overlap_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """Right registrations by method and overlap, whether accepted or not."""
    columns: dict[str, Callable[[Sequence[Row]], str]] = {}
    for low, high in OVERLAPS:
        count = len(shared(where(rows, method=methods[0]), low, high))
        columns[f"{low:.0%}..{high:.0%} ({count} pairs)"] = lambda some, low=low, high=high: percent(
            shared(right(some), low, high), shared(some, low, high)
        )
    columns["all"] = lambda some: rate(right(some), some)
    title = f"{title}. The headings say how many pairs `{methods[0]}` registers"
    return table_of(title, ("method",), by_method(rows, methods if rows else ()), columns)


def trust_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """How many registrations are accepted and refused, rightly or not."""
    columns = {
        "accepted": lambda some: f"{len(accepted(some))}/{len(some)}",
        "accepted though wrong, of all": lambda some: rate(wrong(accepted(some)), some),
        "accepted though wrong, of the accepted": lambda some: f"{len(wrong(accepted(some)))}/{len(accepted(some))}",
        f"refused, of those that share > {CLEAR:.0%}": lambda some: rate(
            refused(shared(some, CLEAR)), shared(some, CLEAR)
        ),
        "refused though right, of the right": lambda some: rate(refused(right(some)), right(some)),
    }
    return table_of(title, ("method",), by_method(rows, methods if rows else ()), columns)


def scene_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Right registrations by method and scene, and how many are accepted though wrong."""
    title = "Right registrations by scene, then how many are accepted though wrong: any yaw, tilt up to 35 degrees"
    columns = for_each(
        "scene",
        distinct(rows, "scene"),
        lambda some: f"{percent(right(some), some)}, {len(wrong(accepted(some)))}",
    )
    return table_of(title, ("method",), by_method(rows, methods if rows else ()), columns)


def accurate(rows: Iterable[Row]) -> list[Row]:
    """Right registrations of pairs that share more than half, at noise up to the paper's first."""
    return [row for row in shared(right(rows), 0.5) if float(row["sigma2"]) <= 1]


def accuracy_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Errors of right registrations of pairs that share much, under little noise."""
    return table_of(
        "Median errors of right registrations, more than half shared, σ² up to 1 m²: any yaw, tilt up to 35 degrees",
        ("method",),
        [group for group in by_method(accurate(rows), methods) if group[1]],
        {
            "registrations": lambda some: str(len(some)),
            "rotation [°]": lambda some: f"{middle(some, 'rotation_deg'):.3f}",
            "translation [voxels]": lambda some: f"{middle(some, 'translation_voxels'):.3f}",
            "translation [m]": lambda some: f"{middle(some, 'translation_m'):.3f}",
        },
    )


def beside_others(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """Ours beside the others; no rows where ours did not run."""
    lines: list[Line] = []
    for words, rows in (("any yaw", yaw), ("any rotation", free)):
        measures = (
            Measure(
                f"accepted yet wrong, {words}",
                lambda r: (wrong(accepted(r)), r),
                "pairs to be accepted though wrong",
                most=False,
            ),
            Measure(
                f"refused though more than {CLEAR:.0%} is shared, {words}",
                lambda r: (refused(shared(r, CLEAR)), shared(r, CLEAR)),
                "such pairs to be refused",
                most=False,
            ),
        )
        lines += [measure.line(rows) for measure in measures if where(rows, method=OURS)]
    for unit, name in (("°", "rotation_deg"), ("voxels", "translation_voxels")):
        if some := accurate(where(yaw, method=OURS)):
            ours, others = (
                f"{middle(some, name):.3f}",
                others_of(accurate(yaw), lambda rows, name=name: middle(rows, name) if rows else None, "{:.3f}".format),
            )
            what = f"median error of what is right, more than half shared, σ² up to 1 m² [{unit}]"
            lines.append((what, ours, others, f"half of such registrations are within {ours} {unit} of the truth"))
    return beside_table([*lines, *_calibration(yaw)])


def _calibration(yaw: Sequence[Row]) -> list[Line]:
    def of(rows: Sequence[Row], value: Callable[[CovarianceCheck], float]) -> float | None:
        checked = calibration(right(rows))
        return None if checked is None else value(checked)

    ours = calibration(right(where(yaw, method=OURS)))
    if ours is None:
        return []
    mean = f"{ours.mean:.2f}; 95 % of calibrated means lie within {ours.low:.2f}..{ours.high:.2f}"
    means = others_of(yaw, lambda rows: of(rows, lambda c: c.mean), "{:.2f}".format)
    shares = others_of(yaw, lambda rows: of(rows, lambda c: c.inside.share), in_percent, most=True)
    inside = f"{ours.inside.share:.1%} ({ours.inside})"
    factor = f"reported standard deviations are {(6 / ours.mean) ** 0.5:.2f} times those of the errors"
    expected = f"expect {100 * ours.inside.share:.0f} of 100 truths in the 95 % ellipsoid"
    return [
        ("mean normalized squared error of what is right (calibrated: 6)", mean, means, factor),
        ("within the 95 % ellipsoid", inside, shares, expected),
    ]


def draw_pairs(folder: Path, rows: Sequence[Row], settings: PairsSettings) -> None:
    """Write success against overlap, and how well covariances and probabilities predict errors and success."""
    methods = settings.compared.methods
    draw_overlap(folder / OVERLAP, rows, methods)
    if OURS in methods:
        draw_nees(folder / NEES, right(where(rows, method=OURS)))
        draw_probability(folder / PROBABILITY, where(rows, method=OURS))


def draw_overlap(path: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """The share of right registrations against the overlap of the scans."""
    figure = new_figure(10.6, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (turn, words) in zip(panels, _TURNS.items(), strict=True):
        for method in methods:
            some = where(rows, turn=turn, method=method)
            tenths = [pairs for low, high in pairwise(_TENTHS) if (pairs := shared(some, low, high))]
            places = [float(column(pairs, "shared").mean()) for pairs in tenths]
            draw_rates(axes, places, [wilson(len(right(pairs)), len(pairs)) for pairs in tenths], method)
        axes.set(title=words, xlabel="share of the points in common", xlim=(0, 1), ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of pairs that are right")
    legend_beside(panels[-1])
    save_figure(figure, path)


def draw_nees(path: Path, rows: Sequence[Row]) -> None:
    """The normalized squared errors of right registrations, and the chi-squared density."""
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
    nees = column(known(rows, "nees"), "nees")
    calibrated = calibration(rows)
    bars = np.linspace(0, _FARTHEST, 31).tolist()
    if calibrated is not None:
        axes.hist(np.clip(nees, 0, _FARTHEST), bins=bars, density=True, color="C0", alpha=0.5, label=OURS)
        axes.axvline(calibrated.mean, color="C0", linewidth=1.5, label=f"its mean, {calibrated.mean:.2f}")
    x = np.linspace(0, _FARTHEST, 301)
    axes.plot(x, chi2.pdf(x, FREEDOM), "k-", linewidth=1.2, label=f"chi-squared({FREEDOM})")
    axes.set(xlabel=f"normalized squared error; all above {_FARTHEST:g} in the last bar", ylabel="density")
    axes.legend(fontsize=8, frameon=False)
    save_figure(figure, path)


def draw_probability(path: Path, rows: Sequence[Row]) -> None:
    """The share of right registrations against the reported probability."""
    figure = new_figure(4.6, 4.4)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], "k--", linewidth=0.9, label="calibrated")
    bins = reliability(rows)
    if bins:
        draw_reliability(axes, [(rated.predicted, rated.right) for rated in bins], (5, -9), 7)
    else:
        axes.set_title(f"{OURS} reports no probability", fontsize=10)
    axes.set(
        xlabel="reported probability (mean of a bin)", ylabel="share that is right", xlim=(0, 1), ylim=(-0.03, 1.03)
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, frameon=False)
    save_figure(figure, path)
