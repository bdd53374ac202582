"""Success over the steps of Table 1: a panel for each noise, a line for each method."""

from collections.abc import Sequence
from pathlib import Path

from sonarmap.tools.lab.reproduce.evaluation.figure import DPI, draw_rates
from sonarmap.tools.lab.reproduce.evaluation.summary import right
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.figure import save_figure
from sonarmap.tools.lab.reproduce.rate import wilson
from sonarmap.tools.lab.reproduce.rows import where


def draw_steps(path: Path, rows: Sequence[Row], methods: Sequence[str]) -> None:
    """Write a PNG.

    Raises:
        InputError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    noises = list(dict.fromkeys(row["sigma2"] for row in rows))
    steps = sorted({int(row["step"]) for row in rows})
    figure = Figure(figsize=(4.2 * len(noises) + 1.8, 3.8), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, len(noises), squeeze=False, sharey=True)[0]
    for axes, sigma2 in zip(panels, noises, strict=True):
        for method in methods:
            by_step = [where(rows, sigma2=sigma2, method=method, step=step) for step in steps]
            draw_rates(axes, steps, [wilson(len(right(trials)), len(trials)) for trials in by_step], method)
        axes.set_title(f"σ² = {sigma2:g} m²", fontsize=11)
        axes.set_xticks(steps, [f"S{step}" for step in steps], fontsize=8)
        axes.set_ylim(-0.03, 1.03)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of seeds that are right")
    panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    save_figure(figure, path)
