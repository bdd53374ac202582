"""`sonarmap evaluate`: compare a trajectory, and its map, pairs and uncertainties, with the truth."""

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import INPUT, MEASUREMENT, RUNNING, completes, flag, option
from sonarmap.tools.command.options.registration import checked, is_positive
from sonarmap.tools.command.options.running import JsonOption
from sonarmap.tools.command.terminal import say, warn
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


_input = partial(option, INPUT)
_limit = partial(option, MEASUREMENT, callback=checked(lambda limit: limit >= 0, "{}; give 0 or more"))


@dataclass(frozen=True, slots=True)
class Comparison:
    """What is compared, how, and what is too much."""

    align: str = option(
        MEASUREMENT,
        "HOW",
        "Align by poses, positions or first. poses are all positions and orientations, positions these alone, first "
        "the first pose.",
        "poses",
        callback=checked(ALIGNMENTS.__contains__, f"{{!r}}; choose one of {', '.join(ALIGNMENTS)}"),
        autocompletion=completes(ALIGNMENTS),
    )
    max_error_m: float | None = _limit("M", "Exit with 3 beyond this position error \\[m].")
    max_error_deg: float | None = _limit("DEG", "Exit with 3 beyond this rotation error \\[deg].")
    map: Path | None = _input("FILE", "The estimate's map, to compare with --surface.")
    surface: Path | None = _input(
        "PATH",
        "The true surface, in the truth's frame. It is a simulation's folder or description.json, or a point cloud.",
    )
    voxel: float | None = _input(
        "M",
        "Edge of the map's voxels \\[m].",
        callback=checked(is_positive, "{}; give a length above 0"),
        shown="from --summary",
    )
    summary: Path | None = _input("FILE", "The map's summary.json, to score pairs and sigmas.")
    verbose: bool = flag(RUNNING, "--verbose -v", "List all poses, however many.")


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM or KITTI format.", metavar="ESTIMATE")],
    truth: Annotated[
        list[Path],
        typer.Argument(
            help="True trajectory, in the same format. For several dives, one file per dive.", metavar="TRUTH..."
        ),
    ],
    options: Comparison,
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

    _check_together(options)
    estimated, true = read_pair(estimate, *truth)
    survey = read_summary(options.summary) if options.summary else None
    result = evaluate(estimated, true, cast("Alignment", options.align))
    error = _map_error(result, options, survey)
    scores = score_survey(survey, true) if survey else {}
    calibration = calibrate_survey(survey, estimated, true) if survey else None
    if as_json:
        further = {
            "map": error.to_json() | {"alignment": options.align} if error else None,
            "pairs": {name: score.to_json() for name, score in scores.items()} or None,
            "uncertainty": calibration.to_json() if calibration else None,
        }
        typer.echo(json.dumps(result.to_json() | further, allow_nan=False))
    else:
        print_poses(result, options.verbose)
        if survey:
            print_scores(scores, RIGHT_DEG, RIGHT_VOXELS * survey.voxel)
        print_trajectory(result)
        if error:
            print_map(error, options.align)
        if calibration:
            print_calibration(calibration)
    if survey and survey.covariances is None:
        say(f"{options.summary} has no covariances of the poses; their uncertainty is not evaluated")
    if result.unmatched_truths:
        warn(f"{result.unmatched_truths} poses of the truth have no estimate")
    if _exceeds(result, options.max_error_m, options.max_error_deg):
        raise typer.Exit(EXCEEDED)


def _check_together(options: Comparison) -> None:
    """Refuse options that need another one, or have no effect without it."""
    if (options.map is None) != (options.surface is None):
        option, missing = ("--map", "--surface") if options.surface is None else ("--surface", "--map")
        raise InputError(f"{option} needs {missing}: the map is compared with the surface; give both, or neither")
    if options.map is None and options.voxel is not None:
        raise InputError("--voxel has no effect without --map and --surface; give them, or leave --voxel out")
    if options.map is not None and options.voxel is None and options.summary is None:
        raise InputError(f"the voxel size of {options.map} is not known; give --voxel, or the map's --summary")


def _map_error(result: "Evaluation", options: Comparison, summary: "SurveySummary | None") -> "MapError | None":
    from sonarmap.tools.lab.evaluate.map_error import map_error, read_points, reference_of

    if options.map is None or options.surface is None:
        return None
    edge = options.voxel or (summary.map_voxel if summary else math.nan)
    return map_error(result.T_truth_estimate.apply(read_points(options.map)), reference_of(options.surface), edge)


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
