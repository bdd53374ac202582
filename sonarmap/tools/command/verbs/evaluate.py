"""`sonarmap evaluate`: compare a trajectory, and its map, pairs and uncertainties, with the truth."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import INPUT, MEASUREMENT, JsonOption, checked, is_positive
from sonarmap.tools.command.terminal import number_table, print_json, print_result, result_console, say, warn

if TYPE_CHECKING:
    from sonarmap.tools.lab.evaluate.map_error import MapError
    from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration
    from sonarmap.tools.lab.evaluate.survey import PairScore, SurveySummary
    from sonarmap.tools.lab.evaluate.trajectory import Alignment, Evaluation

EXCEEDED = 3
_LISTED = 5  # poses beyond the limits
_FIRST = "the first pose alone, whose error moves and turns all others; all poses, the default, fit closest"
ALIGNMENTS = {"poses": "all poses", "positions": "all positions", "first": _FIRST}
ANCHORS = {
    "first": "relative to the first pose",
    "world": "without alignment, both in one world frame",
    "partly": "in one world frame, aligned at the first pose in what no instrument measured",
}
_COUNTS = ("kept_right", "kept_wrong", "rejected_right", "rejected_wrong", "failed", "unjudged")
_SHARES = {"precision": "precision", "recall": "recall"} | {
    "rejections' precision": "rejected_precision",
    "rejections' recall": "rejected_recall",
}


_limit = partial(MEASUREMENT.option, callback=checked(lambda limit: limit >= 0, "{}; give 0 or more"))


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM or KITTI format.", metavar="ESTIMATE")],
    truth: Annotated[
        list[Path],
        typer.Argument(
            help="True trajectory, in the same format. For several dives, one file per dive.", metavar="TRUTH..."
        ),
    ],
    align: str = MEASUREMENT.choice(
        "Align by poses (all positions and orientations), positions (all positions), or first (the first pose).",
        ALIGNMENTS,
        "HOW",
    ),
    max_error_m: float | None = _limit("M", "Exit with 3 beyond this position error \\[m]."),
    max_error_deg: float | None = _limit("DEG", "Exit with 3 beyond this rotation error \\[deg]."),
    map: Path | None = INPUT.option("FILE", "The estimate's map, to compare with --surface."),
    surface: Path | None = INPUT.option(
        "PATH",
        "The true surface, in the truth's frame: a simulation's folder or description.json, or a point cloud.",
    ),
    voxel: float | None = INPUT.option(
        "M",
        "Edge of the map's voxels \\[m].",
        callback=checked(is_positive, "{}; give a length above 0"),
        shown="from --summary",
    ),
    summary: Path | None = INPUT.option("FILE", "The map's summary.json, to score pairs and sigmas."),
    as_json: JsonOption = False,
) -> None:
    """Compare an estimated trajectory with the true one: the error of every pose, of the whole trajectory (ATE) and of
    each step (RPE).

    Poses are matched by their stamps, in KITTI files by line. The truths of several dives are joined in the given
    order; if their stamps count scans from 0, the count continues from dive to dive. --align chooses the rigid
    transform, without scale, that aligns the estimate with the truth: poses, least squares over positions and
    orientations, where 1 rad weighs as much as 1 m; positions, the same without orientations, for at least three
    positions that are not on a line; first, the first pose onto its truth. The map is moved by the same transform.
    Pairs need no alignment, and uncertainties are always compared relative to the first pose.
    """
    from sonarmap.tools.files.readers.trajectory import read_pair
    from sonarmap.tools.lab.evaluate.survey import calibrate_survey, read_summary, score_survey
    from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, evaluate

    _check_together(map, surface, voxel, summary)
    estimated, true = read_pair(estimate, *truth)
    survey = read_summary(summary) if summary else None
    result = evaluate(estimated, true, cast("Alignment", align))
    error = _map_error(result, map, surface, voxel, survey)
    scores = score_survey(survey, true) if survey else {}
    calibration = calibrate_survey(survey, estimated, true) if survey else None
    if as_json:
        print_json(result.to_json() | _further_json(error, align, scores, calibration))
    else:
        if survey:
            _print_scores(scores, RIGHT_DEG, RIGHT_VOXELS * survey.voxel)
        _print_trajectory(result)
        if error:
            _print_map(error, align)
        if calibration:
            _print_calibration(calibration)
    if survey and survey.covariances is None:
        say(f"{summary} has no covariances of the poses; their uncertainty is not evaluated")
    if result.unmatched_truths:
        warn(f"{result.unmatched_truths} poses of the truth have no estimate")
    if _exceeds(result, max_error_m, max_error_deg):
        raise typer.Exit(EXCEEDED)


def _further_json(
    error: "MapError | None", align: str, scores: "Mapping[str, PairScore]", calibration: "PoseCalibration | None"
) -> dict[str, Any]:
    """What --json has beside the errors of the trajectory."""
    return {
        "map": error.to_json() | {"alignment": align} if error else None,
        "pairs": {name: score.to_json() for name, score in scores.items()} or None,
        "uncertainty": calibration.to_json() if calibration else None,
    }


def _check_together(map: Path | None, surface: Path | None, voxel: float | None, summary: Path | None) -> None:
    """Refuse options without the options that they need."""
    if (map is None) != (surface is None):
        option, missing = ("--map", "--surface") if surface is None else ("--surface", "--map")
        raise InputError(f"{option} needs {missing}: the map is compared with the surface; give both, or neither")
    if map is None and voxel is not None:
        raise InputError("--voxel has no effect without --map and --surface; give them, or leave --voxel out")
    if map is not None and voxel is None and summary is None:
        raise InputError(f"the voxel size of {map} is not known; give --voxel, or the map's --summary")


def _map_error(
    result: "Evaluation", map: Path | None, surface: Path | None, voxel: float | None, summary: "SurveySummary | None"
) -> "MapError | None":
    from sonarmap.tools.lab.evaluate.map_error import map_error, read_points, reference_of

    if map is None or surface is None:
        return None
    edge = voxel or (summary.map_voxel if summary else math.nan)
    return map_error(result.T_truth_estimate.apply(read_points(map)), reference_of(surface), edge)


def _exceeds(result: "Evaluation", max_error_m: float | None, max_error_deg: float | None) -> bool:
    """Print poses whose errors exceed the limits; return whether there are any."""
    limits = [math.inf if limit is None else limit for limit in (max_error_m, max_error_deg)]
    beyond = result.beyond(*limits).tolist()
    allowed = [f"{limit:g} {unit}" for limit, unit in zip(limits, ("m", "degrees"), strict=True) if limit < math.inf]
    for k in beyond[:_LISTED]:
        say(
            f"the pose at {_shown_stamp(float(result.stamps[k]))} s is {result.translation_m[k]:.3f} m and "
            f"{result.rotation_deg[k]:.2f} degrees off; the limits are {' and '.join(allowed)}",
            "error: ",
            "bold red",
        )
    if len(beyond) > _LISTED:
        say(f"and {len(beyond) - _LISTED} more poses are farther off than that")
    return bool(beyond)


def _print_trajectory(result: "Evaluation") -> None:
    """Print the errors of the trajectory: ATE, RPE and the worst pose."""
    worst, turned = int(result.translation_m.argmax()), int(result.rotation_deg.argmax())
    print_result(
        f"Positions are off by {result.ate_m:.3f} m (ATE, the root mean square of {len(result.stamps)} poses, "
        f"aligned by {ALIGNMENTS[result.alignment]}), at most by {result.translation_m[worst]:.3f} m, at "
        f"{_shown_stamp(float(result.stamps[worst]))} s."
    )
    print_result(
        f"Rotations are off by {np.median(result.rotation_deg):.2f}° in the median, at most by "
        f"{result.rotation_deg[turned]:.2f}°, at {_shown_stamp(float(result.stamps[turned]))} s."
    )
    if len(result.step_translation_m):
        meters, degrees = result.step_translation_m.max(), result.step_rotation_deg.max()
        print_result(f"Steps are off by at most {meters:.3f} m and {degrees:.2f}° (RPE, of consecutive poses).")


def _print_map(error: "MapError", alignment: str) -> None:
    """Print the distances of the map's points from the true surface."""
    print_result(
        f"The map is off by {error.median_m:.3f} m in the median; 90 % of its points lie within {error.p90_m:.3f} m, "
        f"{100 * error.within_voxel:.1f} % within one voxel ({error.voxel:.3g} m): {len(error.distance_m):,} points "
        f"compared with {error.reference}, aligned like the trajectory by {ALIGNMENTS[alignment]}."
    )


def _print_scores(scores: Mapping[str, "PairScore"], rotation_deg: float, translation_m: float) -> None:
    """Print a table of pairs, with a column for each kind."""
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


def _print_calibration(calibration: "PoseCalibration") -> None:
    """Print how many true poses lie in the estimates' 95 % ellipsoids."""
    print_result(
        f"Uncertainty of {len(calibration.nees)} poses, {ANCHORS[calibration.anchor]}: "
        f"{100 * calibration.within_95:.1f} % of the true poses and "
        f"{100 * calibration.position_within_95:.1f} % of the true positions lie in the 95 % ellipsoid; mean NEES "
        f"{calibration.nees.mean():.2f} (ideal 6), of the positions {calibration.position_nees.mean():.2f} (ideal 3)."
    )
    if calibration.origins_differ:
        east, north, up = calibration.offset.tolist()
        print_result(
            f"This is invalid if the two have different origins, as it seems: all of the truth lies "
            f"{east:+.2f} m East, {north:+.2f} m North and {up:+.2f} m up of the estimate. Give both in one frame."
        )


def _shown_stamp(seconds: float) -> str:
    """A stamp without trailing zeros."""
    return f"{seconds:.6f}".rstrip("0").rstrip(".")
