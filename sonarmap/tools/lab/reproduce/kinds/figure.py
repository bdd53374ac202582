"""Right and believed by kind of scan, and the reliability of the probability in every kind."""

from collections.abc import Sequence
from pathlib import Path

from sonarmap.tools.lab.reproduce.calibration_tables import reliability
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import draw_bars, draw_reliability, new_panels, save_figure
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import TENTHS, expected_error
from sonarmap.tools.lab.reproduce.kinds.settings import KindsSettings
from sonarmap.tools.lab.reproduce.kinds.tables import (
    every_variant,
    tried,
    variant_words,
    without_navigation,
    worst_first,
)
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import where

OUTCOMES, RELIABILITY = "kinds.png", "kinds-probability.png"
_IN_A_LINE, _SHARED = 4, {"sharex": True, "sharey": True}


def draw_kinds(folder: Path, rows: Sequence[Row], _settings: KindsSettings) -> None:
    """Write the PNGs; the second only where ours ran."""
    draw_outcomes(folder / OUTCOMES, rows)
    if ours := without_navigation(where(rows, method=OURS)):
        draw_probability(folder / RELIABILITY, ours)


def draw_outcomes(path: Path, rows: Sequence[Row]) -> None:
    """A panel for every method and what it is given, a bar for every kind, the worst on top."""
    kinds, columns = worst_first(rows), every_variant(rows)
    figure, panels = new_panels(len(columns), _IN_A_LINE, (2.5, 0.26 * len(kinds) + 0.8), (1.2, 0.5), **_SHARED)
    for axes, (method, known) in zip(panels, columns, strict=False):
        draw_bars(axes, [where(tried(rows), kind=kind, method=method, priors=known) for kind in kinds])
        axes.set_title(variant_words(method, known).replace(", known", ",\nknown"), fontsize=9)
        axes.set_xlim(0, 1)
        axes.tick_params(labelsize=8)
    panels[0].set_yticks(range(len(kinds)), kinds)
    panels[0].invert_yaxis()
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    save_figure(figure, path)


def draw_probability(path: Path, rows: Sequence[Row]) -> None:
    """A panel for every kind: the share right against the reported probability, in ten bins."""
    kinds = worst_first(rows)
    figure, panels = new_panels(len(kinds), _IN_A_LINE, (2.6, 2.7), (0.4, 0.2), **_SHARED)
    for axes, kind in zip(panels, kinds, strict=False):
        some = where(rows, kind=kind)
        axes.plot([0, 1], [0, 1], "k--", linewidth=0.8)
        draw_reliability(axes, [(rated.predicted, rated.right) for rated in reliability(some, TENTHS)], (4, -9), 6)
        axes.set_title(f"{kind}: {expected_error(some):.3f}", fontsize=9)
        axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    figure.supxlabel("reported probability (mean of a bin)", fontsize=9)
    figure.supylabel("share that is right", fontsize=9)
    save_figure(figure, path)
