"""Table 1 for people: the tables, and the page that holds them."""

from statistics import median

from tools.evaluate import RIGHT_DEG, RIGHT_VOXELS
from tools.reproduce.gaussian import EXTENT, GaussianResult, GaussianSettings
from tools.reproduce.gaussian_summary import Summary, summarize
from tools.reproduce.methods import METHODS
from tools.reproduce.table import Table
from tools.reproduce.wilson import wilson
from tools.simulate.series import TABLE1_COUNT


def gaussian_tables(result: GaussianResult) -> list[Table]:
    """The verdict beside the paper's, what lies behind it, and every scan for itself."""
    summaries = summarize(result)
    return [
        _verdict_table(summaries),
        _detail_table(summaries),
        *(_scan_table(result, sigma2) for sigma2 in result.settings.sigma2),
    ]


def describe_right(settings: GaussianSettings) -> str:
    """What counts as right, in a sentence."""
    meters = RIGHT_VOXELS * settings.grid.voxel
    return (
        f"Right is within {RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the grid used ({meters:g} m): the "
        "translation of T_target_source between the sensor frames decides. The paper shows curves and says up to "
        "which scan they succeed, without a bound."
    )


def gaussian_page(result: GaussianResult, picture: str, rows: str) -> str:
    """The Markdown page.

    Args:
        result: of the experiment.
        picture: file name of the figure beside the page.
        rows: file name of the CSV beside the page.
    """
    settings = result.settings
    tables = "\n".join(table.markdown() for table in gaussian_tables(result))
    methods = "\n".join(f"- **{name}**: {method.title}" for name, method in METHODS.items())
    return f"""# Gaussian noise along the beams: Table 1, Figs. 20 and 21

Scans S0 to S9 of the scene `{settings.scene}`, step by step farther from the reference scan, by (4, 8, 12) m and by 6,
2 and 1 degrees of yaw, roll and pitch, are registered to it. The variance of the noise grows along the beam to σ² at
the largest range. Grid: {settings.edge} voxels of {settings.grid.voxel:g} m, {EXTENT:g} m as the paper's 256 voxels.
Seeds: {_seeds(settings)}; each has a scene and noise of its own. Rates with Wilson's 95 % intervals.

{describe_right(settings)}

{methods}

{tables}
![Estimated and true parameters over S0 to S9]({picture})

Every registration: [{rows}]({rows}). Made in {result.seconds:.0f} s on {result.device} by

    {_command(settings)}
"""


def _seeds(settings: GaussianSettings) -> str:
    last = settings.first_seed + settings.seeds - 1
    return f"{settings.first_seed}" if settings.seeds == 1 else f"{settings.first_seed} to {last}"


def _command(settings: GaussianSettings) -> str:
    noises = " ".join(f"--sigma2 {sigma2:g}" for sigma2 in settings.sigma2)
    return (
        f"sonarmap reproduce gaussian --scene {settings.scene} --grid {settings.edge} {noises} "
        f"--seeds {settings.seeds} --seed {settings.first_seed}"
    )


def _verdict_table(summaries: list[Summary]) -> Table:
    return Table(
        "The last scan that succeeds, all before it too",
        ("σ² [m²]", "method", "paper", "ours, by seed", "verdict", "right", "accepted, wrong", "refused, right"),
        tuple(
            (
                f"{summary.sigma2:g}",
                summary.method,
                "" if summary.paper is None else f"S{summary.paper}",
                " ".join(_scan(last) for last in summary.last),
                summary.verdict,
                str(summary.right),
                str(summary.accepted_wrong),
                str(summary.refused_right),
            )
            for summary in summaries
        ),
    )


def _detail_table(summaries: list[Summary]) -> Table:
    return Table(
        "What lies behind it",
        (
            "σ² [m²]",
            "method",
            "right",
            "with the translation at the scan's center",
            "also within 3 m",
            "wrong first in yaw / tilt / translation",
            "median error where right",
            "median s",
        ),
        tuple(
            (
                f"{summary.sigma2:g}",
                summary.method,
                str(summary.right.successes),
                str(summary.right_at_center),
                str(summary.right_within_3m),
                " / ".join(str(count) for count in summary.wrong_steps.values()),
                "" if summary.rotation_deg is None else f"{summary.rotation_deg:.2f}°, {summary.translation_m:.2f} m",
                f"{summary.seconds:.2f}",
            )
            for summary in summaries
        ),
    )


def _scan_table(result: GaussianResult, sigma2: float) -> Table:
    """Every scan under one noise: rates, and the median error of all seeds, right or wrong."""
    rows = {method: result.of(sigma2, method) for method in METHODS}
    lines = []
    for index in range(TABLE1_COUNT):
        cells = []
        for method in METHODS:
            trials = [row.trial for row in rows[method] if row.index == index]
            rotation = median(trial.error.rotation_deg for trial in trials)
            distance = median(trial.error.translation_m for trial in trials)
            cells += [str(wilson(sum(t.right for t in trials), len(trials))), f"{rotation:.1f}°, {distance:.1f} m"]
        lines.append((_scan(index), *cells))
    headings = [heading for method in METHODS for heading in (f"{method}: right", "median error")]
    return Table(f"Every scan at σ² = {sigma2:g} m²", ("scan", *headings), tuple(lines))


def _scan(index: int) -> str:
    return "none" if index < 0 else f"S{index}"
