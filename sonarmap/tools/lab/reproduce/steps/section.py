"""Table 1, extended to S12, in words and tables."""

from collections.abc import Sequence
from statistics import median_low

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import accepted, last_right, rate, right, wrong
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.steps.settings import StepsSettings
from sonarmap.tools.lab.reproduce.table import Table, verdict
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, TABLE1_MOST

PICTURE = "steps.png"

# The required share of right registrations from S0 to S9: up to the variance ROUGH [m^2], and beyond it.
REQUIRED, ROUGH, REQUIRED_ROUGH = 0.95, 2.0, 0.9


def steps_section(rows: Sequence[Row], settings: StepsSettings) -> Section:
    """The requirements on ours, then every method's success, step by step and in all."""
    tables = [_required(rows, settings), _reach(rows, settings)]
    tables += [_by_step(where(rows, sigma2=sigma2), settings, sigma2) for sigma2 in settings.sigma2]
    return Section(
        title="Table 1, extended to S12",
        introduction=_introduction(settings),
        tables=(*tables, _by_scene(rows, settings)),
        times=(),
        pictures={
            PICTURE: f"Share of the seeds that are right at each step of Table 1. The band is the 95 % interval of "
            f"`{OURS}`."
        },
    )


def _required(rows: Sequence[Row], settings: StepsSettings) -> Table:
    lines = []
    for sigma2 in settings.sigma2:
        ours = where(rows, sigma2=sigma2, method=OURS)
        if not ours:
            continue
        ends, accepted_wrong = last_right(ours), wrong(accepted(ours))
        reached = sum(end >= TABLE1_COUNT - 1 for end in ends)
        shown = f"{rate(right(_through(ours)), _through(ours))}; every step to S9 with {reached} of {len(ends)} seeds"
        noise = f"{OURS}, σ² = {sigma2:g} m²"
        least = REQUIRED if sigma2 <= ROUGH else REQUIRED_ROUGH
        through = _through(ours)
        enough = len(right(through)) >= least * len(through)
        lines.append((f"{noise}: S0 to S9 right", f">= {least:.0%}", shown, verdict(enough)))
        lines.append(
            (
                f"{noise}: accepted though wrong",
                "none",
                f"{rate(accepted_wrong, accepted(ours))}",
                verdict(not accepted_wrong),
            )
        )
    return Table("Requirements", ("measure", "required", "ours", "verdict"), tuple(lines))


def _reach(rows: Sequence[Row], settings: StepsSettings) -> Table:
    lines = []
    for sigma2 in settings.sigma2:
        for method in settings.compared.methods:
            some = where(rows, sigma2=sigma2, method=method)
            ends, beyond = last_right(some), [row for row in some if int(row["step"]) >= TABLE1_COUNT]
            lines.append(
                (
                    f"{sigma2:g}",
                    method,
                    rate(right(_through(some)), _through(some)),
                    rate(right(beyond), beyond),
                    f"{_step(median_low(ends))} ({_step(min(ends))}..{_step(max(ends))})",
                    rate(wrong(accepted(some)), accepted(some)),
                )
            )
    headings = (
        "σ² [m²]",
        "method",
        "right, S0 to S9",
        "right, S10 to S12",
        "last step before the first failure: median (worst..best)",
        "wrong, of the accepted",
    )
    return Table("How far each method gets", headings, tuple(lines))


def _by_step(rows: Sequence[Row], settings: StepsSettings, sigma2: float) -> Table:
    steps = range(TABLE1_MOST)
    lines = []
    for method in settings.compared.methods:
        by_step = [where(rows, method=method, step=step) for step in steps]
        lines.append((method, *(f"{len(right(trials))}/{len(trials)}" for trials in by_step)))
    title = f"Right registrations at each step, σ² = {sigma2:g} m²"
    return Table(title, ("method", *(_step(step) for step in steps)), tuple(lines))


def _by_scene(rows: Sequence[Row], settings: StepsSettings) -> Table:
    lines = []
    for method in settings.compared.methods:
        by_scene = [_through(where(rows, method=method, scene=scene)) for scene in settings.scenes]
        lines.append((method, *(rate(right(trials), trials) for trials in by_scene)))
    return Table("Right registrations by scene, S0 to S9, all noise levels", ("method", *settings.scenes), tuple(lines))


def _through(rows: Sequence[Row]) -> list[Row]:
    """The steps of the paper's Table 1."""
    return [row for row in rows if int(row["step"]) < TABLE1_COUNT]


def _step(step: int) -> str:
    return f"S{step}" if step >= 0 else "none"


def _introduction(settings: StepsSettings) -> str:
    first, last = settings.first_seed, settings.first_seed + settings.seeds - 1
    others = settings.compared.methods != (OURS,)
    fewer = (
        f" The methods other than `{OURS}` register only the first {settings.peers} seeds."
        if settings.peers < settings.seeds and others
        else ""
    )
    seeds = f"{first} to {last}" if last > first else f"{first}"
    return (
        "Scans S0 to S9 of the paper's Table 1, each farther from the reference scan and turned more than the one "
        "before, and S10 to S12, which continue with the same steps. The noise is Gaussian along the beams (Sect. 3 of "
        f"the paper; σ² is the variance at the largest range). Seeds: {seeds}. Scenes, in turn: "
        f"{', '.join(settings.scenes)}. The grid has {settings.edge} voxels of {settings.grid.voxel:g} m along each "
        f"edge. A registration is right if it is within {RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the "
        f"truth, between the sensors' frames. {settings.compared.words}{fewer}"
    )
