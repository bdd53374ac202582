"""Reads what an evaluation needs of a survey's summary.json."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from kernels.errors import InputError
from tools.evaluate.pairs import TriedPair
from tools.readers.json_file import read_json
from tools.readers.poses.matrices import rigid_transform


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


class _Pair(BaseModel):
    target: int
    source: int
    role: str
    kept: bool
    T_target_source: Matrix | None = None


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
    pairs: list[_Pair]
    components: list[_Component]


def read_summary(path: Path) -> SurveySummary:
    """Read a summary.json of `sonarmap map`; keys that an evaluation does not need are ignored.

    Raises:
        InputError: the file is missing, is not JSON, or is not the summary of a survey.
    """
    content = read_json(path, "the summary.json of `sonarmap map`")
    try:
        summary = _Summary.model_validate(content)
        pairs = tuple(_tried_pair(pair) for pair in summary.pairs)
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
        pairs=pairs,
        voxel=summary.settings.grid.voxel,
        map_voxel=summary.components[0].map.voxel_m,
    )


def _tried_pair(pair: _Pair) -> TriedPair:
    if pair.T_target_source is None:
        return TriedPair(pair.target, pair.source, pair.role, pair.kept, None)
    T = rigid_transform(pair.T_target_source, f"the pair {pair.target} - {pair.source}")
    return TriedPair(pair.target, pair.source, pair.role, pair.kept, T)


def _covariances(scans: list[_Scan]) -> np.ndarray | None:
    """(N, 6, 6), or None where a scan has none; ValueError for another shape."""
    covariances = [scan.covariance for scan in scans if scan.covariance is not None]
    if not scans or len(covariances) < len(scans):
        return None
    return np.array(covariances, np.float64).reshape(len(scans), 6, 6)
