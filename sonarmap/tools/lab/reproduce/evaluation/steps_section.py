"""Table 1, extended to S12, in words, tables and a figure."""

from collections.abc import Sequence
from pathlib import Path
from statistics import median_low

from sonarmap.tools.lab.reproduce.beside import Measure, beside_table
from sonarmap.tools.lab.reproduce.evaluation.settings import StepsSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import draw_rates, legend_beside, new_figure, save_figure
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    accepted,
    by_method,
    for_each,
    last_right,
    rate,
    right,
    step_name,
    where,
    wilson,
    wrong,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, TABLE1_MOST

PICTURE = "steps.png"


def steps_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: StepsSettings) -> Section:
    """Ours beside the others, then every method's success, step by step and in all."""
    methods = settings.compared.methods
    tables = [_beside(rows, settings), _reach(rows, settings)]
    for sigma2 in settings.sigma2:
        title, some = f"Right registrations at each step, σ² = {sigma2:g} m²", where(rows, sigma2=sigma2)
        cells = for_each("step", range(TABLE1_MOST), lambda trials: f"{len(right(trials))}/{len(trials)}")
        columns = {f"S{step}": cell for step, cell in cells.items()}
        tables.append(table_of(title, ("method",), by_method(some, methods), columns))
    scenes = for_each("scene", settings.scenes, lambda trials: rate(right(trials), trials))
    title = "Right registrations by scene, S0 to S9, all noise levels"
    tables.append(table_of(title, ("method",), by_method(_through(rows), methods), scenes))
    return Section(
        title="Table 1, extended to S12",
        tables=tuple(tables),
        pictures={
            PICTURE: f"Share of the seeds that are right at each step of Table 1. The band is the 95 % interval of "
            f"`{OURS}`."
        },
    )


def draw_steps(folder: Path, rows: Sequence[Row], settings: StepsSettings) -> None:
    """Write a PNG: a panel for each noise, a line for each method."""
    noises = list(dict.fromkeys(row["sigma2"] for row in rows))
    steps = sorted({int(row["step"]) for row in rows})
    figure = new_figure(4.2 * len(noises) + 1.8, 3.8)
    panels = figure.subplots(1, len(noises), squeeze=False, sharey=True)[0]
    for axes, sigma2 in zip(panels, noises, strict=True):
        for method in settings.compared.methods:
            by_step = [where(rows, sigma2=sigma2, method=method, step=step) for step in steps]
            draw_rates(axes, steps, [wilson(len(right(trials)), len(trials)) for trials in by_step], method)
        axes.set_title(f"σ² = {sigma2:g} m²", fontsize=11)
        axes.set_xticks(steps, [f"S{step}" for step in steps], fontsize=8)
        axes.set_ylim(-0.03, 1.03)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of seeds that are right")
    legend_beside(panels[-1])
    save_figure(figure, folder / PICTURE)


def _beside(rows: Sequence[Row], settings: StepsSettings) -> Table:
    lines = []
    for sigma2 in settings.sigma2:
        some, noise = where(rows, sigma2=sigma2), f"σ² = {sigma2:g} m²"
        measures = (
            Measure(f"right, S0 to S9, {noise}", lambda r: (right(_through(r)), _through(r)), "to be right"),
            Measure(
                f"wrong, of the accepted, {noise}",
                lambda r: (wrong(accepted(r)), accepted(r)),
                "accepted registrations to be wrong",
                most=False,
            ),
        )
        lines += [measure.line(some) for measure in measures if where(some, method=OURS)]
    return beside_table(lines)


def _reach(rows: Sequence[Row], settings: StepsSettings) -> Table:
    def ends(some: Sequence[Row]) -> str:
        last = last_right(some, "step", "scene", "seed")
        return f"{step_name(median_low(last))} ({step_name(min(last))}..{step_name(max(last))})"

    def beyond(some: Sequence[Row]) -> list[Row]:
        return [row for row in some if int(row["step"]) >= TABLE1_COUNT]

    return table_of(
        "How far each method gets",
        ("σ² [m²]", "method"),
        [
            ((f"{sigma2:g}", method), where(rows, sigma2=sigma2, method=method))
            for sigma2 in settings.sigma2
            for method in settings.compared.methods
        ],
        {
            "right, S0 to S9": lambda some: rate(right(_through(some)), _through(some)),
            "right, S10 to S12": lambda some: rate(right(beyond(some)), beyond(some)),
            "last step before the first failure: median (worst..best)": ends,
            "wrong, of the accepted": lambda some: rate(wrong(accepted(some)), accepted(some)),
        },
    )


def _through(rows: Sequence[Row]) -> list[Row]:
    """The steps of the paper's Table 1."""
    return [row for row in rows if int(row["step"]) < TABLE1_COUNT]
