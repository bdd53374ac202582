"""Reads what an evaluation needs of a survey's summary.json, and of the table of pairs beside it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.pairs import TriedPair, read_pairs
from sonarmap.tools.files.readers.csv_table import PAIRS
from sonarmap.tools.files.readers.json_file import read_json


@dataclass(frozen=True, slots=True)
class SurveySummary:
    """What a summary.json says of its survey.

    Attributes:
        stamps: (N,) float64 [s], of its scans.
        components: indices of each component's scans, ascending.
        unmeasured: of each component that instruments place in the world, what none of them tells
            (`slam.graph.measured_poses.MEASURED`); empty for the others.
        covariances: (N, 6, 6) of the poses relative to the first pose of their component, rotation first [rad, m], body
            tangent; None where a scan has none.
        pairs: all pairs that were tried.
        voxel: edge of the voxels on which pairs were registered [m].
        map_voxel: edge of the first map's voxels [m].
    """

    stamps: np.ndarray
    components: tuple[tuple[int, ...], ...]
    unmeasured: tuple[tuple[str, ...], ...]
    covariances: np.ndarray | None
    pairs: tuple[TriedPair, ...]
    voxel: float
    map_voxel: float


Matrix = list[list[float]]


class _Scan(BaseModel):
    stamp: float
    covariance: Matrix | None = None


class _Pairs(BaseModel):
    tried: int


class _Map(BaseModel):
    voxel_m: float


class _Component(BaseModel):
    scans: list[int]
    unmeasured: list[str] = []
    map: _Map


class _Grid(BaseModel):
    voxel: float


class _Settings(BaseModel):
    grid: _Grid


class _Summary(BaseModel):
    settings: _Settings
    scans: list[_Scan]
    pairs: _Pairs
    components: list[_Component]


def read_summary(path: Path) -> SurveySummary:
    """Read a summary.json of `sonarmap map` and the pairs.csv beside it, without what an evaluation does not need.

    Raises:
        InputError: the file is missing, is not JSON, or is not the summary of a survey; or its pairs.csv is missing, or
            damaged, or of another map.
    """
    content = read_json(path, "the summary.json of `sonarmap map`")
    if isinstance(content, dict) and isinstance(content.get("pairs"), list):
        raise InputError(f"{path} is of an earlier version, which had no {PAIRS}; map again into the same folder")
    try:
        summary = _Summary.model_validate(content)
        covariances = _covariances(summary.scans)
    except ValidationError as error:
        fault = error.errors()[0]
        key = ".".join(map(str, fault["loc"])) or "the file"
        raise InputError(f"{path}: {key}: {fault['msg']}; expected the summary.json of `sonarmap map`") from error
    except ValueError as error:
        raise InputError(f"cannot read {path}: {error}; expected the summary.json of `sonarmap map`") from error
    if not summary.components:
        raise InputError(f"{path}: it has no component; expected the summary.json of `sonarmap map`")
    return SurveySummary(
        stamps=np.array([scan.stamp for scan in summary.scans], np.float64),
        components=tuple(tuple(component.scans) for component in summary.components),
        unmeasured=tuple(tuple(component.unmeasured) for component in summary.components),
        covariances=covariances,
        pairs=_tried_pairs(path, summary),
        voxel=summary.settings.grid.voxel,
        map_voxel=summary.components[0].map.voxel_m,
    )


def _tried_pairs(path: Path, summary: _Summary) -> tuple[TriedPair, ...]:
    """The pairs of the table beside the summary."""
    table = path.with_name(PAIRS)
    if not table.exists():
        raise InputError(f"{path} needs the {PAIRS} of its map beside it, and there is none; copy it there")
    pairs = read_pairs(table, len(summary.scans))
    if len(pairs) != summary.pairs.tried:
        raise InputError(
            f"{path} counts {summary.pairs.tried} pairs, and {table} has {len(pairs)}; give both files of one map, "
            "whole"
        )
    return pairs


def _covariances(scans: list[_Scan]) -> np.ndarray | None:
    """(N, 6, 6), or None where a scan has none; ValueError for another shape."""
    covariances = [scan.covariance for scan in scans if scan.covariance is not None]
    if not scans or len(covariances) < len(scans):
        return None
    return np.array(covariances, np.float64).reshape(len(scans), 6, 6)
