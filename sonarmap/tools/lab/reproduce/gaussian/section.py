"""Table 1 in words and tables."""

from collections.abc import Iterable, Sequence
from statistics import median

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.experiment import Section
from sonarmap.tools.lab.reproduce.gaussian.row import RANKED, GaussianRow, GaussianTime
from sonarmap.tools.lab.reproduce.gaussian.series import VARIANTS
from sonarmap.tools.lab.reproduce.gaussian.summary import FEW, Summary, among, summarize
from sonarmap.tools.lab.reproduce.rows import wilson
from sonarmap.tools.lab.reproduce.table import Table, table_of

# Voxels per edge -> seconds of a registration from the raw scans (Sect. 4.4; MATLAB, 2010)
_PAPER_SECONDS = {128: 10.5, 256: 60.6}


def section(scene: str, extent: float, rows: Sequence[GaussianRow], times: Sequence[GaussianTime]) -> Section:
    """The section, from the rows and times of all registrations.

    Args:
        scene: a key of SCENE_KINDS.
        extent: of the grid [m].
        rows, times: of every registration.
    """
    summaries = summarize(rows)
    cases = dict.fromkeys((row.grid, row.sigma2) for row in rows)
    return Section(
        title="Gaussian noise along the beams: Table 1, Figs. 20 and 21",
        introduction=_introduction(scene, extent, rows),
        tables=(
            _verdict_table(summaries),
            _detail_table(summaries),
            *(_scan_table([row for row in rows if (row.grid, row.sigma2) == case], *case) for case in cases),
        ),
        times=(_time_table(times),),
        pictures=_pictures(rows),
        remarks=remarks(rows),
    )


def parameters_picture(edge: int) -> str:
    """File name of the picture after Figs. 20 and 21 on a grid."""
    return f"gaussian-{edge}.png"


def rates_picture() -> str:
    """File name of the picture of success rates."""
    return "gaussian-rates.png"


def describe_right(rows: Sequence[GaussianRow]) -> str:
    """What counts as right, in a sentence."""
    voxels = dict.fromkeys((row.grid, row.voxel_m) for row in rows)
    meters = ", ".join(f"{RIGHT_VOXELS * voxel:g} m at {grid}³" for grid, voxel in voxels)
    return (
        f"A registration is right if T_target_source, between the sensor frames, is within {RIGHT_DEG:g} degrees and "
        f"{RIGHT_VOXELS:g} voxels of the truth ({meters}). The paper shows curves and says up to which scan its "
        "registrations succeed, but gives no error bound."
    )


def _introduction(scene: str, extent: float, rows: Sequence[GaussianRow]) -> str:
    grids = " and ".join(dict.fromkeys(f"{row.grid}³ voxels of {row.voxel_m:g} m" for row in rows))
    methods = "\n".join(f"- **{name}**: {method.title}" for name, method in VARIANTS.items())
    return f"""Scans S0 to S9 of the scene `{scene}` are registered to a reference scan. Each is farther from it than
the one before, by (4, 8, 12) m and by 6, 2 and 1 degrees of yaw, roll and pitch. The variance of the noise grows along
the beam, to σ² at the largest range. Grids: {grids}, {extent:g} m along each edge, as the paper's 256 voxels. Seeds:
{_seeds(rows)}; each has a scene and noise of its own. Rates have Wilson's 95 % intervals.

{describe_right(rows)}

{methods}"""


def _seeds(rows: Sequence[GaussianRow]) -> str:
    first, last = min(row.seed for row in rows), max(row.seed for row in rows)
    return f"{first}" if first == last else f"{first} to {last}"


def _pictures(rows: Sequence[GaussianRow]) -> dict[str, str]:
    seed = min(row.seed for row in rows)
    captions = {
        parameters_picture(row.grid): f"As Figs. 20 and 21, {row.grid}³ voxels, seed {seed}. Lines are true values, "
        "crosses are estimates; gray marks wrong registrations."
        for row in rows
    }
    return captions | {rates_picture(): "The share of seeds that are right at each scan, with 95 % intervals."}


def _verdict_table(summaries: Sequence[Summary]) -> Table:
    return table_of(
        "The last scan before the first failure",
        ("grid", "σ²", "method"),
        [(_case(summary), summary) for summary in summaries],
        {
            "paper": lambda summary: "" if summary.paper is None else f"S{summary.paper}",
            "ours, median (each seed)": lambda summary: (
                f"{_scan(summary.median_last)} ({' '.join(_scan(last) for last in summary.last)})"
            ),
            "verdict": lambda summary: summary.verdict,
            "right": lambda summary: str(summary.right),
            "accepted though wrong": lambda summary: str(summary.accepted_wrong),
            "refused though right": lambda summary: str(summary.refused_right),
        },
    )


def _detail_table(summaries: Sequence[Summary]) -> Table:
    def counts(numbers: Iterable[int]) -> str:
        return " / ".join(map(str, numbers))

    return table_of(
        "Which step fails first, and how accurate the right registrations are",
        ("grid", "σ²", "method"),
        [(_case(summary), summary) for summary in summaries],
        {
            "first wrong: yaw / tilt / translation": lambda summary: counts(summary.wrong_steps.values()),
            "series ended by each of these": lambda summary: counts(summary.ended_by.values()),
            f"right yaw is the highest peak / among the {FEW} highest / among the {RANKED} highest": lambda summary: (
                counts(summary.yaw_peaks)
            ),
            "right": lambda summary: str(summary.right.successes),
            "right with the translation at the scan's center": lambda summary: str(summary.right_at_center),
            "right and within 3 m": lambda summary: str(summary.right_within_3m),
            "median error where right": lambda summary: (
                "" if summary.rotation_deg is None else f"{summary.rotation_deg:.2f}°, {summary.translation_m:.2f} m"
            ),
        },
    )


def _scan_table(rows: Sequence[GaussianRow], grid: int, sigma2: float) -> Table:
    """Every scan on one grid under one noise: rates, and the median error of all seeds, right or wrong."""
    methods = dict.fromkeys(row.method for row in rows)
    lines = []
    for index in sorted({row.scan for row in rows}):
        cells = []
        for method in methods:
            trials = [row for row in rows if (row.scan, row.method) == (index, method)]
            rotation, distance = median(t.rotation_deg for t in trials), median(t.translation_m for t in trials)
            cells += [str(wilson(sum(t.right for t in trials), len(trials))), f"{rotation:.1f}°, {distance:.1f} m"]
        lines.append((_scan(index), *cells))
    headings = [heading for method in methods for heading in (f"{method}: right", "median error")]
    return Table(f"Every scan at {grid}³, σ² = {sigma2:g} m²", ("scan", *headings), tuple(lines))


def _time_table(times: Sequence[GaussianTime]) -> Table:
    lines = []
    for grid, method in dict.fromkeys((time.grid, time.method) for time in times):
        mine = [time for time in times if (time.grid, time.method) == (grid, method)]
        prepare, register = median(time.prepare_s for time in mine), median(time.register_s for time in mine)
        paper = f"{_PAPER_SECONDS[grid]:g} s" if grid in _PAPER_SECONDS else ""
        cells = (f"{2 * prepare + register:.2f} s", f"{prepare:.2f} s", f"{register:.2f} s")
        lines.append((f"{grid}³", method, paper, *cells))
    headings = ("grid", "method", "paper, from raw scans", "two preparations and one registration")
    return Table("Median run times", (*headings, "one preparation", "one registration"), tuple(lines))


def _case(summary: Summary) -> tuple[str, str, str]:
    return f"{summary.grid}³", f"σ² = {summary.sigma2:g} m²", summary.method


def _scan(index: int) -> str:
    return "none" if index < 0 else f"S{index}"


# Structure fixed to the sensor or to the grid has its false yaw peaks at multiples of a quarter turn.
_QUARTERS = 4
_NEAR_DEG = 15.0
_BY_CHANCE = _QUARTERS * 2 * RIGHT_DEG / 360


def remarks(rows: Sequence[GaussianRow]) -> str:
    """One paragraph for each grid and method that fails anywhere."""
    cases = dict.fromkeys((row.grid, row.method) for row in rows)
    paragraphs = [_paragraph(grid, method, rows) for grid, method in cases]
    return "\n".join(f"- {paragraph}" for paragraph in paragraphs)


def _paragraph(grid: int, method: str, rows: Sequence[GaussianRow]) -> str:
    mine = [row for row in rows if (row.grid, row.method) == (grid, method)]
    steps = {step: [row for row in mine if row.wrong_step == step] for step in ("yaw", "tilt", "translation")}
    wrong = sum(len(rows_of_step) for rows_of_step in steps.values())
    where = f"**{grid}³, {method}**: "
    if not wrong:
        return f"{where}all {len(mine)} registrations are right."
    counts = ", ".join(f"{step} in {len(rows_of_step)}" for step, rows_of_step in steps.items() if rows_of_step)
    sentences = [f"{where}{wrong} of {len(mine)} registrations are wrong. The first wrong step is {counts}."]
    if steps["yaw"]:
        sentences += [_on_yaw(steps["yaw"]), *_on_near(steps["yaw"]), *_on_others(steps["yaw"], rows)]
    if steps["tilt"]:
        sentences.append(
            f"Where roll and pitch are wrong first, the vertical is off by a median of {_median(steps['tilt'])}."
        )
    if steps["translation"]:
        sentences.append(_on_translation(steps["translation"]))
    return " ".join(sentences)


def _on_yaw(wrong: Sequence[GaussianRow]) -> str:
    """How the yaw is wrong, whether roll and pitch are right, and whether the false peak is fixed to the sensor."""
    errors = [row.yaw_error_deg for row in wrong]
    near, about = sum(error <= _NEAR_DEG for error in errors), sum(error >= 180 - _NEAR_DEG for error in errors)
    upright = sum(row.tilt_error_deg <= RIGHT_DEG for row in wrong)
    quarters = sum(_from_quarter(row.found_yaw_deg) <= RIGHT_DEG for row in wrong)
    return (
        f"Of these {len(wrong)} yaws, {near} are off by at most {_NEAR_DEG:g} degrees, {about} by 180 degrees (to "
        f"within {_NEAR_DEG:g}) and {len(wrong) - near - about} by another angle; roll and pitch are right in "
        f"{upright} of them. The number within {RIGHT_DEG:g} degrees of 0, 90, 180 or 270, where structure fixed to "
        f"the sensor or to the grid has its peaks, is {quarters} (by chance: {_BY_CHANCE:.0%}). The right yaw is the "
        f"highest peak of the first step in {among(wrong, 1)}, among its {FEW} highest in {among(wrong, FEW)} and "
        f"among its {RANKED} highest in {among(wrong, RANKED)}."
    )


def _on_near(wrong: Sequence[GaussianRow]) -> list[str]:
    """Whether yaws that are nearly right err to one side, and by how much these scans are tilted."""
    near = [row for row in wrong if row.yaw_error_deg <= _NEAR_DEG]
    if not near:
        return []
    small = sum((row.found_yaw_deg - row.true_yaw_deg + 180) % 360 < 180 for row in near)
    rolls = [abs(row.true_roll_deg) for row in near]
    return [
        f"Yaws off by at most {_NEAR_DEG:g} degrees are too small in {small} of {len(near)} cases; their median error "
        f"is {median(row.yaw_error_deg for row in near):.0f} degrees, under true rolls of {min(rolls):.0f} to "
        f"{max(rolls):.0f} degrees."
    ]


def _on_others(wrong: Sequence[GaussianRow], rows: Sequence[GaussianRow]) -> list[str]:
    """How often each other method has the right yaw where this one has not."""
    method = wrong[0].method
    pairs = {row.pair for row in wrong}
    sentences = []
    for name in dict.fromkeys(row.method for row in rows if row.method != method):
        count = sum(row.pair in pairs and row.method == name and row.yaw_error_deg <= RIGHT_DEG for row in rows)
        sentences.append(f"*{name}* has the right yaw in {count} of these {len(pairs)}.")
    return sentences


def _on_translation(wrong: Sequence[GaussianRow]) -> str:
    rotation = median(row.rotation_deg for row in wrong)
    distance = median(row.translation_m for row in wrong)
    near = sum(row.right_at_center for row in wrong)
    return (
        f"Where only the translation is wrong, the median errors are {rotation:.1f} degrees and {distance:.1f} m. "
        f"Measured at the scan's center, {near} of {len(wrong)} would be right; in these, the translation at the "
        "sensor is wrong because the sensor is far from the scan's center and the rotation is slightly off."
    )


def _from_quarter(yaw_deg: float) -> float:
    return abs((yaw_deg + 45) % 90 - 45)


def _median(rows: Sequence[GaussianRow]) -> str:
    return f"{median(row.tilt_error_deg for row in rows):.0f} degrees"
