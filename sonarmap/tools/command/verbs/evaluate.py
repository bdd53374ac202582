"""`sonarmap evaluate`: compare a trajectory, and its map, pairs and uncertainties, with the truth."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import INPUT, MEASUREMENT, RUNNING, completes
from sonarmap.tools.command.options.registration import JsonOption
from sonarmap.tools.command.terminal import say
from sonarmap.tools.command.words.evaluation import (
    ALIGNMENTS,
    print_calibration,
    print_map,
    print_poses,
    print_scores,
    print_trajectory,
    shown_stamp,
)

if TYPE_CHECKING:
    from sonarmap.tools.lab.evaluate.map_error import MapError
    from sonarmap.tools.lab.evaluate.survey import SurveySummary
    from sonarmap.tools.lab.evaluate.trajectory import Alignment, Evaluation

EXCEEDED = 3
_LISTED = 5  # poses beyond the limits


def _check_alignment(alignment: str) -> str:
    if alignment in ALIGNMENTS:
        return alignment
    raise typer.BadParameter(f"{alignment!r}; choose one of {', '.join(ALIGNMENTS)}")


def _check_limit(limit: float | None) -> float | None:
    if limit is None or limit >= 0:
        return limit
    raise typer.BadParameter(f"{limit}; give 0 or more")


def _check_length(length: float | None) -> float | None:
    if length is None or 0 < length < math.inf:
        return length
    raise typer.BadParameter(f"{length}; give a length above 0")


TruthArgument = Annotated[
    list[Path],
    typer.Argument(
        help="True trajectory, in the same format. For several dives, one file per dive.", metavar="TRUTH..."
    ),
]
AlignOption = Annotated[
    str,
    typer.Option(
        "--align",
        metavar="HOW",
        help="Align by poses, positions or first. poses are all positions and orientations, positions these alone, "
        "first the first pose.",
        callback=_check_alignment,
        rich_help_panel=MEASUREMENT,
        autocompletion=completes(ALIGNMENTS),
    ),
]
MaxErrorOption = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Exit with 3 beyond this position error \\[m].",
        callback=_check_limit,
        rich_help_panel=MEASUREMENT,
    ),
]
MaxTurnOption = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="Exit with 3 beyond this rotation error \\[deg].",
        callback=_check_limit,
        rich_help_panel=MEASUREMENT,
    ),
]
MapOption = Annotated[
    Path | None,
    typer.Option("--map", metavar="FILE", help="The estimate's map, to compare with --surface.", rich_help_panel=INPUT),
]
SurfaceOption = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="The true surface, in the truth's frame. It is a simulation's folder or description.json, or a point "
        "cloud.",
        rich_help_panel=INPUT,
    ),
]
MapVoxelOption = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Edge of the map's voxels \\[m].",
        callback=_check_length,
        rich_help_panel=INPUT,
        show_default="from --summary",
    ),
]
SummaryOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="The map's summary.json, to score pairs and sigmas.", rich_help_panel=INPUT),
]
VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="List all poses, however many.", rich_help_panel=RUNNING)
]


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM or KITTI format.", metavar="ESTIMATE")],
    truth: TruthArgument,
    align: AlignOption = "poses",
    max_error_m: MaxErrorOption = None,
    max_error_deg: MaxTurnOption = None,
    map_file: MapOption = None,
    surface: SurfaceOption = None,
    voxel: MapVoxelOption = None,
    summary: SummaryOption = None,
    verbose: VerboseOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare an estimated trajectory with the true one: the error of every pose, of the whole trajectory (ATE) and of
    each step (RPE).

    Poses are matched by their stamps, in KITTI files by their line. The truths of several dives are joined in the given
    order; where the stamps of each count its scans from 0, the count goes on from dive to dive. --align chooses the
    rigid transform, without scale, that lays the estimate over the truth: poses, least squares over positions and
    orientations, where 1 rad counts as much as 1 m; positions, the same without the orientations, for at least three
    positions that are not on a line; first, the first pose onto its truth. The map is moved by the same transform.
    Pairs need no alignment, and uncertainties are always compared relative to the first pose.
    """
    from sonarmap.tools.files.readers.poses.trajectory import read_pair
    from sonarmap.tools.lab.evaluate.survey import calibrate_survey, read_summary, score_survey
    from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, evaluate

    _check_together(map_file, surface, voxel, summary)
    estimated, true = read_pair(estimate, *truth)
    survey = read_summary(summary) if summary else None
    result = evaluate(estimated, true, cast("Alignment", align))
    error = _map_error(result, map_file, surface, voxel, survey)
    scores = score_survey(survey, true) if survey else {}
    calibration = calibrate_survey(survey, estimated, true) if survey else None
    if as_json:
        further = {
            "map": error.to_json() | {"alignment": align} if error else None,
            "pairs": {name: score.to_json() for name, score in scores.items()} or None,
            "uncertainty": calibration.to_json() if calibration else None,
        }
        typer.echo(json.dumps(result.to_json() | further, allow_nan=False))
    else:
        print_poses(result, verbose)
        if survey:
            print_scores(scores, RIGHT_DEG, RIGHT_VOXELS * survey.voxel)
        print_trajectory(result)
        if error:
            print_map(error, align)
        if calibration:
            print_calibration(calibration)
    if survey and survey.covariances is None:
        say(f"{summary} has no covariances of the poses; their uncertainty is not evaluated")
    if result.unmatched_truths:
        say(f"{result.unmatched_truths} poses of the truth have no estimate", "warning: ", "bold yellow")
    if _exceeds(result, max_error_m, max_error_deg):
        raise typer.Exit(EXCEEDED)


def _check_together(map_file: Path | None, surface: Path | None, voxel: float | None, summary: Path | None) -> None:
    """Refuse options that need another one, or have no effect without it."""
    if (map_file is None) != (surface is None):
        option, missing = ("--map", "--surface") if surface is None else ("--surface", "--map")
        raise InputError(f"{option} needs {missing}: the map is compared with the surface; give both, or neither")
    if map_file is None and voxel is not None:
        raise InputError("--voxel has no effect without --map and --surface; give them, or leave --voxel out")
    if map_file is not None and voxel is None and summary is None:
        raise InputError(f"the voxel size of {map_file} is not known; give --voxel, or the map's --summary")


def _map_error(
    result: "Evaluation",
    map_file: Path | None,
    surface: Path | None,
    voxel: float | None,
    summary: "SurveySummary | None",
) -> "MapError | None":
    from sonarmap.tools.lab.evaluate.map_error import map_error, read_points, reference_of

    if map_file is None or surface is None:
        return None
    edge = voxel or (summary.map_voxel if summary else math.nan)
    return map_error(result.T_truth_estimate.apply(read_points(map_file)), reference_of(surface), edge)


def _exceeds(result: "Evaluation", max_error_m: float | None, max_error_deg: float | None) -> bool:
    """Print the poses whose errors are too large; whether there are any."""
    limits = [math.inf if limit is None else limit for limit in (max_error_m, max_error_deg)]
    beyond = result.beyond(*limits).tolist()
    allowed = [f"{limit:g} {unit}" for limit, unit in zip(limits, ("m", "degrees"), strict=True) if limit < math.inf]
    for k in beyond[:_LISTED]:
        say(
            f"the pose at {shown_stamp(float(result.stamps[k]))} s is {result.translation_m[k]:.3f} m and "
            f"{result.rotation_deg[k]:.2f} degrees off; the limits are {' and '.join(allowed)}",
            "error: ",
            "bold red",
        )
    if len(beyond) > _LISTED:
        say(f"and {len(beyond) - _LISTED} more poses are farther off than that")
    return bool(beyond)
