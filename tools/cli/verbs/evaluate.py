"""`sonarmap evaluate`: an estimated trajectory beside the truth, and with it a map, pairs and uncertainties."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from kernels.errors import InputError
from tools.cli.evaluation_text import (
    ALIGNMENTS,
    print_calibration,
    print_map,
    print_scores,
    print_trajectory,
    shown_stamp,
)
from tools.cli.options import JsonOption
from tools.cli.terminal import say

if TYPE_CHECKING:
    from tools.evaluate.map_error import MapError
    from tools.evaluate.trajectory import Alignment, Evaluation
    from tools.readers.summary import SurveyAccount

EXCEEDED = 3


def _check_alignment(alignment: str) -> str:
    if alignment in ALIGNMENTS:
        return alignment
    raise typer.BadParameter(f"{alignment}; wanted one of {', '.join(ALIGNMENTS)}")


def _check_limit(limit: float | None) -> float | None:
    if limit is None or limit >= 0:
        return limit
    raise typer.BadParameter(f"{limit}; wanted 0 or more")


def _check_length(length: float | None) -> float | None:
    if length is None or 0 < length < math.inf:
        return length
    raise typer.BadParameter(f"{length}; wanted a length above 0")


MapOption = Annotated[
    Path | None,
    typer.Option("--map", metavar="FILE", help="The estimate's map, to be held against --surface."),
]
SurfaceOption = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="What is truly there, in the truth's frame: a simulation's folder or description.json, or points.",
    ),
]
MapVoxelOption = Annotated[
    float | None,
    typer.Option(metavar="M", help="Edge of the map's voxels \\[m]. \\[as --summary says]", callback=_check_length),
]
SummaryOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="The map's summary.json: tells which pairs are right, and whether its uncertainty is."
    ),
]


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM or KITTI.", metavar="ESTIMATE")],
    truth: Annotated[
        list[Path],
        typer.Argument(help="True trajectory, in the same format; of several dives one each.", metavar="TRUTH..."),
    ],
    align: Annotated[
        str,
        typer.Option(
            "--align",
            metavar="HOW",
            help="How the estimate is laid over the truth: by all poses (positions and orientations), by all "
            "positions, or by the first pose.",
            callback=_check_alignment,
        ),
    ] = "poses",
    max_error_m: Annotated[
        float | None,
        typer.Option(metavar="M", help="Exit code 3 where a position is farther off \\[m].", callback=_check_limit),
    ] = None,
    max_error_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Exit code 3 where a pose is turned more \\[deg].", callback=_check_limit),
    ] = None,
    map_file: MapOption = None,
    surface: SurfaceOption = None,
    voxel: MapVoxelOption = None,
    summary: SummaryOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare an estimated trajectory with the true one: every pose, the whole (ATE) and each step (RPE).

    Poses belong together where their stamps agree, or by their line in KITTI files. The truths of several dives are put
    one after the other, and stamps that count scans from 0 in each are counted on. The alignment is a rigid motion,
    without scale: poses, least squares over positions and orientations, 1 rad weighing as much as 1 m; positions, the
    same without the orientations, for three or more that lie on no line; first, the first pose upon its truth. A map is
    laid over the truth as its trajectory is. Pairs need no alignment, and poses' uncertainties are judged against the
    first pose, whatever --align says.
    """
    from tools.evaluate.survey import calibrate_survey, score_survey
    from tools.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, evaluate
    from tools.readers.poses.trajectory import read_pair
    from tools.readers.summary import read_summary

    _check_together(map_file, surface, voxel, summary)
    found, true = read_pair(estimate, *truth)
    account = read_summary(summary) if summary else None
    result = evaluate(found, true, cast("Alignment", align))
    error = _map_error(result, map_file, surface, voxel, account)
    scores = score_survey(account, true) if account else {}
    calibration = calibrate_survey(account, found, true) if account else None
    if as_json:
        beside = {
            "map": error.to_json() | {"alignment": align} if error else None,
            "pairs": {name: score.to_json() for name, score in scores.items()} or None,
            "uncertainty": calibration.to_json() if calibration else None,
        }
        typer.echo(json.dumps(result.to_json() | beside, allow_nan=False))
    else:
        print_trajectory(result)
        if error:
            print_map(error, align)
        if account:
            print_scores(scores, RIGHT_DEG, RIGHT_VOXELS * account.voxel)
        if calibration:
            print_calibration(calibration)
    if account and account.covariances is None:
        say(f"{summary} has no covariances of the poses, whose uncertainty is not judged")
    if result.unmatched_truths:
        say(f"{result.unmatched_truths} poses of the truth have no estimate", "warning: ", "bold yellow")
    if _exceeds(result, max_error_m, max_error_deg):
        raise typer.Exit(EXCEEDED)


def _check_together(map_file: Path | None, surface: Path | None, voxel: float | None, summary: Path | None) -> None:
    """Refuse options that want another one, or would go unheard."""
    if (map_file is None) != (surface is None):
        given, missing = ("--map", "--surface") if surface is None else ("--surface", "--map")
        raise InputError(f"{given} is given without {missing}; a map is held against a surface: give both")
    if map_file is None and voxel is not None:
        raise InputError("--voxel is the map's and no map is given; give --map and --surface, or drop --voxel")
    if map_file is not None and voxel is None and summary is None:
        raise InputError(f"how large the voxels of {map_file} are is not told; give --voxel or its --summary")


def _map_error(
    result: "Evaluation",
    map_file: Path | None,
    surface: Path | None,
    voxel: float | None,
    account: "SurveyAccount | None",
) -> "MapError | None":
    from tools.evaluate.map_error import map_error, read_points, reference_of

    if map_file is None or surface is None:
        return None
    edge = voxel or (account.map_voxel if account else math.nan)
    return map_error(result.T_truth_estimate.apply(read_points(map_file)), reference_of(surface), edge)


def _exceeds(result: "Evaluation", max_error_m: float | None, max_error_deg: float | None) -> bool:
    """Tell the poses whose errors are too large."""
    limits = [math.inf if limit is None else limit for limit in (max_error_m, max_error_deg)]
    beyond = result.beyond(*limits).tolist()
    allowed = [f"{limit:g} {unit}" for limit, unit in zip(limits, ("m", "degrees"), strict=True) if limit < math.inf]
    for k in beyond:
        say(
            f"the pose at {shown_stamp(float(result.stamps[k]))} s is {result.translation_m[k]:.3f} m and "
            f"{result.rotation_deg[k]:.2f} degrees off; allowed are {' and '.join(allowed)}",
            "error: ",
            "bold red",
        )
    return bool(beyond)
