"""What `sonarmap evaluate` prints about a trajectory, a map, pairs and uncertainties."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import typer
from rich.table import Table
from rich.text import Text

from tools.cli.terminal import printable, result_console

if TYPE_CHECKING:
    from tools.evaluate.map_error import MapError
    from tools.evaluate.pairs import PairScore
    from tools.evaluate.pose_calibration import PoseCalibration
    from tools.evaluate.trajectory import Evaluation

ALIGNMENTS = {"poses": "all poses", "positions": "all positions", "first": "the first pose"}
ANCHORS = {
    "first": "relative to the first pose",
    "world": "without alignment, both in one world frame",
    "partly": "in one world frame, aligned at the first pose in what no instrument measured",
}
_COUNTS = ("kept_right", "kept_wrong", "rejected_right", "rejected_wrong", "failed", "unjudged")


def print_trajectory(result: "Evaluation") -> None:
    """Every pose beside its truth, then ATE and RPE."""
    from tools.evaluate.trajectory import yaw_deg

    table = Table(box=None, pad_edge=False)
    positions = ("stamp [s]", "estimated x, y, z [m]", "true x, y, z [m]", "off [m]")
    for name in (*positions, "estimated yaw", "true yaw", "rotated by"):
        table.add_column(Text(name), justify="right", no_wrap=True)  # brackets are no markup
    estimated_yaw, true_yaw = yaw_deg(result.T_aligned), yaw_deg(result.T_true)
    for k, stamp in enumerate(result.stamps.tolist()):
        table.add_row(
            shown_stamp(stamp),
            _place(result.T_aligned.translation[k].tolist()),
            _place(result.T_true.translation[k].tolist()),
            f"{result.translation_m[k]:.3f}",
            f"{estimated_yaw[k]:+.2f}°",
            f"{true_yaw[k]:+.2f}°",
            f"{result.rotation_deg[k]:.2f}°",
        )
    result_console().print(table)
    typer.echo(f"{len(result.stamps)} poses, aligned by {ALIGNMENTS[result.alignment]}")
    typer.echo(f"ATE (root mean square of the position errors): {result.ate_m:.3f} m")
    if len(result.step_translation_m):
        typer.echo(
            f"RPE (worst step): {result.step_translation_m.max():.3f} m, {result.step_rotation_deg.max():.2f} degrees"
        )


def print_map(error: "MapError", alignment: str) -> None:
    """The distances of the map's points from the true surface."""
    typer.echo(
        f"map: {len(error.distance_m)} points compared with {printable(error.reference)}, aligned like the trajectory "
        f"by {ALIGNMENTS[alignment]}: median {error.median_m:.3f} m off, 90 % within {error.p90_m:.3f} m, "
        f"{100 * error.within_voxel:.1f} % within one voxel ({error.voxel:.3g} m)"
    )


def print_scores(scores: Mapping[str, "PairScore"], rotation_deg: float, translation_m: float) -> None:
    """One row for each kind of pair."""
    table = Table(box=None, pad_edge=False)
    shares = ("precision", "recall", "rejections' precision", "rejections' recall")
    table.add_column(f"pairs, right within {rotation_deg:g}° and {translation_m:.2f} m", no_wrap=True)
    for name in (*(name.replace("_", " ") for name in _COUNTS), *shares):
        table.add_column(name, justify="right", no_wrap=True)
    for name, score in scores.items():
        counts = [str(getattr(score, count)) for count in _COUNTS]
        ratios = (score.precision, score.recall, score.rejected_precision, score.rejected_recall)
        table.add_row(name, *counts, *("-" if share is None else f"{share:.3f}" for share in ratios))
    result_console().print(table)


def print_calibration(calibration: "PoseCalibration") -> None:
    """How many true poses lie within the estimates' 95 % ellipsoids."""
    typer.echo(
        f"uncertainty of {len(calibration.nees)} poses, {ANCHORS[calibration.anchor]}: "
        f"{100 * calibration.within_95:.1f} % of the true poses and "
        f"{100 * calibration.position_within_95:.1f} % of the true positions lie in the 95 % ellipsoid; mean NEES "
        f"{calibration.nees.mean():.2f} (ideal 6), of the positions {calibration.position_nees.mean():.2f} (ideal 3)"
    )


def shown_stamp(seconds: float) -> str:
    """A stamp without trailing zeros."""
    return f"{seconds:.6f}".rstrip("0").rstrip(".")


def _place(meters: list[float]) -> str:
    return " ".join(f"{value:8.2f}" for value in meters)
