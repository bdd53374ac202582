"""What `sonarmap evaluate` prints about a trajectory, a map, pairs and uncertainties."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.command.terminal import number_table, print_result, result_console

if TYPE_CHECKING:
    from rich.table import Table

    from sonarmap.tools.lab.evaluate.map_error import MapError
    from sonarmap.tools.lab.evaluate.pairs import PairScore
    from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration
    from sonarmap.tools.lab.evaluate.trajectory import Evaluation

ALIGNMENTS = {"poses": "all poses", "positions": "all positions", "first": "the first pose"}
ANCHORS = {
    "first": "relative to the first pose",
    "world": "without alignment, both in one world frame",
    "partly": "in one world frame, aligned at the first pose in what no instrument measured",
}
MOST_POSES = 12  # of which each has a row
WORST = 10  # rows, where there are more
_COUNTS = ("kept_right", "kept_wrong", "rejected_right", "rejected_wrong", "failed", "unjudged")
_SHARES = {"precision": "precision", "recall": "recall"} | {
    "rejections' precision": "rejected_precision",
    "rejections' recall": "rejected_recall",
}
_WIDE = 112  # columns for estimated beside true poses


def print_poses(result: "Evaluation", everything: bool) -> None:
    """Poses beside their truth: all if `everything`, else, of many, those that are off farthest."""
    rows = list(range(len(result.stamps)))
    if len(rows) > MOST_POSES and not everything:
        rows = sorted(np.argsort(-result.translation_m, kind="stable")[:WORST].tolist())
        print_result(f"The {WORST} of {len(result.stamps)} poses that are off farthest; --verbose lists all:")
    console = result_console()
    console.print(_pose_table(result, rows, console.width >= _WIDE))
    console.print()


def _pose_table(result: "Evaluation", rows: Sequence[int], wide: bool) -> "Table":
    """Where there is little room without the estimated poses, so that no number is cut at 80 columns."""
    from sonarmap.tools.lab.evaluate.trajectory import yaw_deg

    estimated, true = result.T_aligned.translation, result.T_true.translation
    estimated_yaw, true_yaw = yaw_deg(result.T_aligned), yaw_deg(result.T_true)
    columns = {
        "stamp [s]": [shown_stamp(float(result.stamps[k])) for k in rows],
        "estimated x, y, z [m]": [_place(estimated[k].tolist()) for k in rows],
        "true x, y, z [m]": [_place(true[k].tolist()) for k in rows],
        "off [m]": [f"{result.translation_m[k]:.3f}" for k in rows],
        "estimated yaw": [f"{estimated_yaw[k]:+.2f}°" for k in rows],
        "true yaw": [f"{true_yaw[k]:+.2f}°" for k in rows],
        "rotated by": [f"{result.rotation_deg[k]:.2f}°" for k in rows],
    }
    narrow = ("stamp [s]", "true x, y, z [m]", "true yaw", "off [m]", "rotated by")
    names = tuple(columns) if wide else narrow
    table = number_table(*names)
    for row in zip(*(columns[name] for name in names), strict=True):
        table.add_row(*row)
    return table


def print_trajectory(result: "Evaluation") -> None:
    """How far off the trajectory is: ATE, RPE and the worst pose."""
    worst, turned = int(result.translation_m.argmax()), int(result.rotation_deg.argmax())
    print_result(
        f"Positions are off by {result.ate_m:.3f} m (ATE, the root mean square of {len(result.stamps)} poses, "
        f"aligned by {ALIGNMENTS[result.alignment]}), at most by {result.translation_m[worst]:.3f} m, at "
        f"{shown_stamp(float(result.stamps[worst]))} s."
    )
    print_result(
        f"Rotations are off by {np.median(result.rotation_deg):.2f}° in the median, at most by "
        f"{result.rotation_deg[turned]:.2f}°, at {shown_stamp(float(result.stamps[turned]))} s."
    )
    if len(result.step_translation_m):
        meters, degrees = result.step_translation_m.max(), result.step_rotation_deg.max()
        print_result(f"Steps are off by at most {meters:.3f} m and {degrees:.2f}° (RPE, of consecutive poses).")


def print_map(error: "MapError", alignment: str) -> None:
    """The distances of the map's points from the true surface."""
    print_result(
        f"The map is off by {error.median_m:.3f} m in the median; 90 % of its points lie within {error.p90_m:.3f} m, "
        f"{100 * error.within_voxel:.1f} % within one voxel ({error.voxel:.3g} m): {len(error.distance_m):,} points "
        f"compared with {error.reference}, aligned like the trajectory by {ALIGNMENTS[alignment]}."
    )


def print_scores(scores: Mapping[str, "PairScore"], rotation_deg: float, translation_m: float) -> None:
    """One column for each kind of pair."""
    table = number_table(f"pairs, right within {rotation_deg:g}° and {translation_m:.2f} m", *scores, words=1)
    table.columns[0].no_wrap = True
    for count in _COUNTS:
        table.add_row(f"  {count.replace('_', ' ')}", *(f"{getattr(score, count):,}" for score in scores.values()))
    for name, attribute in _SHARES.items():
        shares = [getattr(score, attribute) for score in scores.values()]
        table.add_row(f"  {name}", *("-" if share is None else f"{share:.3f}" for share in shares))
    console = result_console()
    console.print(table)
    console.print()


def print_calibration(calibration: "PoseCalibration") -> None:
    """How many true poses lie within the estimates' 95 % ellipsoids."""
    print_result(
        f"Uncertainty of {len(calibration.nees)} poses, {ANCHORS[calibration.anchor]}: "
        f"{100 * calibration.within_95:.1f} % of the true poses and "
        f"{100 * calibration.position_within_95:.1f} % of the true positions lie in the 95 % ellipsoid; mean NEES "
        f"{calibration.nees.mean():.2f} (ideal 6), of the positions {calibration.position_nees.mean():.2f} (ideal 3)."
    )


def shown_stamp(seconds: float) -> str:
    """A stamp without trailing zeros."""
    return f"{seconds:.6f}".rstrip("0").rstrip(".")


def _place(meters: list[float]) -> str:
    return " ".join(f"{value:8.2f}" for value in meters)
