"""What an evaluation needs of a survey's summary.json."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from tools.evaluate.pairs import TriedPair


@dataclass(frozen=True, slots=True)
class SurveyAccount:
    """A survey as its summary tells of it.

    Attributes:
        stamps: (N,) float64 [s], of its scans.
        components: indices of the scans of each component, ascending, as they are written.
        covariances: (N, 6, 6) of the poses against the first one of their component, rotation first [rad, m], body
            tangent; None where the summary has none for every scan.
        pairs: all that were tried.
        voxel: edge of the voxels on which pairs were registered [m].
        map_voxel: edge of the first map's voxels [m].
    """

    stamps: np.ndarray
    components: tuple[tuple[int, ...], ...]
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


def read_summary(path: Path) -> SurveyAccount:
    """The account in a summary.json of `sonarmap map`; keys that are not needed are passed over.

    Raises:
        InputError: no such file, no JSON, or no survey's summary.
    """
    try:
        told = _Summary.model_validate(json.loads(path.read_text(encoding="utf-8")))
        pairs = tuple(_tried(pair) for pair in told.pairs)
        covariances = _covariances(told.scans)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"])) or "the whole"
        raise InputError(f"{path}: {where}: {fault['msg']}; wanted the summary.json of `sonarmap map`") from error
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {error}; wanted the summary.json of `sonarmap map`") from error
    if not told.components:
        raise InputError(f"{path}: it has no component; wanted the summary.json of `sonarmap map`")
    return SurveyAccount(
        stamps=np.array([scan.stamp for scan in told.scans], np.float64),
        components=tuple(tuple(component.scans) for component in told.components),
        covariances=covariances,
        pairs=pairs,
        voxel=told.settings.grid.voxel,
        map_voxel=told.components[0].map.voxel_m,
    )


def _tried(pair: _Pair) -> TriedPair:
    T = None if pair.T_target_source is None else RigidTransform.from_matrix(np.array(pair.T_target_source))
    return TriedPair(pair.target, pair.source, pair.role, pair.kept, T)


def _covariances(scans: list[_Scan]) -> np.ndarray | None:
    """(N, 6, 6), or None where a scan has none; ValueError for another shape."""
    told = [scan.covariance for scan in scans if scan.covariance is not None]
    if not scans or len(told) < len(scans):
        return None
    return np.array(told, np.float64).reshape(len(scans), 6, 6)
