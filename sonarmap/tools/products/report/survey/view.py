# pyright: strict, reportUnknownMemberType=false
"""A part of a finished map, as its pictures show it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Literal, get_args

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.pair import Pair
from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.products.report.naming import inputs_of, plain_text, survey_date, survey_name
from sonarmap.tools.products.report.survey.frame import MapFrame, frame_of

Verdict = Literal["kept", "rejected", "refused"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
_LONGEST = 60  # name in the title


@dataclass(frozen=True, slots=True)
class PartView:
    """What is drawn of a part, whose n scans share a frame."""

    title: str  # name and date of the survey, and which part this is
    size: str  # scans, points and voxel in words
    frame: MapFrame  # what its coordinates mean
    point_map: PointMap  # its points, without the doubtful ones
    trajectory: Trajectory  # its n poses
    # chained, chained_poses: the same before the loops
    chained: PointMap
    chained_poses: Trajectory
    covariances: np.ndarray  # (n, 6, 6) of the poses, rotation first [rad, m], body tangent
    scans: tuple[int, ...]  # n numbers of the scans in the survey, ascending
    names: tuple[str, ...]  # of the n scans
    surveys: tuple[int, ...]  # the survey of each
    survey_names: Mapping[int, str]  # of the surveys, by their numbers
    pairs: tuple[Pair, ...]  # all that were tried within it

    def loops(self, verdict: Verdict) -> list[tuple[int, int]]:
        """The loops of which this became, as places in the trajectory."""
        place = {scan: k for k, scan in enumerate(self.scans)}
        loops = (pair for pair in self.pairs if pair.role == "loop")
        return [(place[pair.i], place[pair.j]) for pair in loops if verdict_of(pair) == verdict]

    def legs(self) -> dict[int, list[int]]:
        """The places in the trajectory of the scans of each survey, by its number."""
        return {
            number: [k for k, each in enumerate(self.surveys) if each == number] for number in sorted(set(self.surveys))
        }


def verdict_of(pair: Pair) -> Verdict:
    """What became of a pair: kept; rejected, though its registration was sure; or refused by the registration."""
    if pair.kept:
        return "kept"
    return "rejected" if pair.accepted else "refused"


def part_view(
    result: SurveyResult,
    rank: int,
    names: Sequence[str],
    settings: Mapping[str, Any],
    georeference: Georeference | None = None,
) -> PartView:
    """The view of map number `rank`, 1 for the largest, of scans with these names; `inputs` of the settings name the
    survey. None for a georeference where it is not known."""
    maps = placed(result.components)
    c = maps[rank - 1]
    scans, part = result.components[c], result.parts[c]
    trajectory = result.trajectory.take(scans)
    of_parts = f"part {rank} of {len(maps)}" if len(maps) > 1 else ""
    called = [plain_text(survey_name(inputs_of(settings)), _LONGEST), survey_date(trajectory.stamps), of_parts]
    surveys, own = tuple(result.surveys[k] for k in scans), set(scans)
    point_map = part.optimized
    return PartView(
        title=", ".join(filter(None, called)),
        size=f"{counted(len(scans), 'scan')}, {counted(len(point_map.points), 'point')}, voxel {point_map.voxel:.3g} m",
        frame=frame_of(result, c, georeference),
        point_map=point_map,
        trajectory=trajectory,
        chained=part.chained,
        chained_poses=part.chained_poses,
        covariances=result.covariances[list(scans)],
        scans=tuple(scans),
        names=tuple(names[k] for k in scans),
        surveys=surveys,
        survey_names=_survey_names(names, result.surveys),
        pairs=tuple(pair for pair in result.pairs if own.issuperset(pair.scans)),
    )


def _survey_names(names: Sequence[str], surveys: Sequence[int]) -> dict[int, str]:
    """Each survey's number, and the folder that its scans' names share, if they tell one."""
    folders: dict[int, set[str]] = {}
    for name, number in zip(names, surveys, strict=True):
        folders.setdefault(number, set()).add(PurePath(name).parent.as_posix())
    shown = {number: next(iter(paths)) if len(paths) == 1 else "." for number, paths in folders.items()}
    return {
        number: f"survey {number}" + ("" if folder == "." else f" ({plain_text(folder, 24)})")
        for number, folder in sorted(shown.items())
    }
