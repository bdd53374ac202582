"""Evaluation of a survey from its summary.json and pairs.csv: scores of its pairs, calibration of its poses."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import AliasPath, BaseModel, Field, ValidationError
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.names import CHAIN, TriedPair, read_pairs
from sonarmap.tools.files.readers.csv_table import PAIRS
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration, calibrate_poses
from sonarmap.tools.lab.evaluate.trajectory import associate, pair_error


@dataclass(frozen=True, slots=True)
class PairScore:
    """Numbers of pairs that the survey kept or rejected, and that are right or wrong."""

    # these four count the pairs whose registration did not fail
    kept_right: int
    kept_wrong: int
    rejected_right: int
    rejected_wrong: int
    failed: int = 0  # pairs whose registration failed
    unjudged: int = 0  # pairs with a scan that has no true pose

    @property
    def precision(self) -> float | None:
        """Share of the kept pairs that are right; None if none was kept."""
        return _share(self.kept_right, self.kept_wrong)

    @property
    def recall(self) -> float | None:
        """Share of the right pairs that were kept; None if none was right."""
        return _share(self.kept_right, self.rejected_right)

    @property
    def rejected_precision(self) -> float | None:
        """Share of the rejected pairs that are wrong; None if none was rejected."""
        return _share(self.rejected_wrong, self.rejected_right)

    @property
    def rejected_recall(self) -> float | None:
        """Share of the wrong pairs that were rejected; None if none was wrong."""
        return _share(self.rejected_wrong, self.kept_wrong)

    def to_json(self) -> dict[str, Any]:
        """The numbers and the shares."""
        shares = ("precision", "recall", "rejected_precision", "rejected_recall")
        return asdict(self) | {name: getattr(self, name) for name in shares}


def score_pairs(pairs: Sequence[TriedPair], truth: Mapping[int, RigidTransform], voxel: float) -> PairScore:
    """Count the tried pairs that are right by `PairError.is_right`; `truth` holds T_world_sensor by index of the scan.

    Recall is over the tried pairs only. `voxel` is the edge of the voxels of their registration [m].
    """
    counts = Counter(_outcome(pair, truth, voxel) for pair in pairs)
    return PairScore(*(counts[field.name] for field in fields(PairScore)))


def _outcome(pair: TriedPair, truth: Mapping[int, RigidTransform], voxel: float) -> str:
    """Name of the field of PairScore that counts the pair."""
    if pair.T_target_source is None:
        return "failed"
    if pair.target not in truth or pair.source not in truth:
        return "unjudged"
    right = pair_error(pair.T_target_source, truth[pair.target].inv() * truth[pair.source]).is_right(voxel)
    return f"{'kept' if pair.kept else 'rejected'}_{'right' if right else 'wrong'}"


def _share(part: int, rest: int) -> float | None:
    return part / (part + rest) if part + rest else None


@dataclass(frozen=True, slots=True)
class SurveySummary:
    """The contents of a summary.json and its pairs.csv that an evaluation needs."""

    stamps: np.ndarray  # (N,) float64 [s], of the scans
    components: tuple[tuple[int, ...], ...]  # indices of each component's scans, ascending
    # degrees of freedom that no instrument measured (`slam.graph.gauge.MEASURED`), of each component that instruments
    # place in the world; empty for other components
    unmeasured: tuple[tuple[str, ...], ...]
    # (N, 6, 6) of the poses relative to the first pose of their component, rotation first [rad, m], body tangent; None
    # if any scan lacks one
    covariances: np.ndarray | None
    pairs: tuple[TriedPair, ...]  # all pairs that were tried
    voxel: float  # edge of the voxels on which pairs were registered [m]
    map_voxel: float  # edge of the first map's voxels [m]


Matrix = list[list[float]]


class _Finite(BaseModel, allow_inf_nan=False):
    """Refuses "nan" and "inf", which pydantic accepts as numbers even if they are text."""


class _Scan(_Finite):
    stamp: float
    covariance: Matrix | None = None


class _Component(_Finite):
    scans: list[int]
    unmeasured: list[str] = []
    voxel: float = Field(validation_alias=AliasPath("map", "voxel_m"))


class _Summary(_Finite):
    scans: list[_Scan]
    components: list[_Component]
    voxel: float = Field(validation_alias=AliasPath("settings", "grid", "voxel"))
    tried: int = Field(validation_alias=AliasPath("pairs", "tried"))


def read_summary(path: Path) -> SurveySummary:
    """Read the summary.json of `sonarmap map` and the pairs.csv beside it.

    Raises InputError: a file is missing or damaged, is no summary of a survey, or belongs to another map.
    """
    content = read_json(path, "the summary.json of `sonarmap map`")
    if isinstance(content, dict) and isinstance(content.get("pairs"), list):
        raise InputError(f"{path} was written by an earlier version, without {PAIRS}; map again into the same folder")
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
        raise InputError(f"{path} has no component; expected the summary.json of `sonarmap map`")
    return SurveySummary(
        stamps=np.array([scan.stamp for scan in summary.scans], np.float64),
        components=tuple(tuple(component.scans) for component in summary.components),
        unmeasured=tuple(tuple(component.unmeasured) for component in summary.components),
        covariances=covariances,
        pairs=_tried_pairs(path, summary),
        voxel=summary.voxel,
        map_voxel=summary.components[0].voxel,
    )


def _tried_pairs(path: Path, summary: _Summary) -> tuple[TriedPair, ...]:
    """The pairs of the table beside the summary."""
    table = path.with_name(PAIRS)
    if not table.exists():
        raise InputError(f"{path} needs the {PAIRS} of its map beside it; copy it there")
    pairs = read_pairs(table, len(summary.scans))
    if len(pairs) != summary.tried:
        raise InputError(
            f"{path} counts {summary.tried} pairs, and {table} has {len(pairs)}; give both files of one map"
        )
    return pairs


def _covariances(scans: list[_Scan]) -> np.ndarray | None:
    """(N, 6, 6), or None if a scan has none. Raises ValueError: another shape."""
    covariances = [scan.covariance for scan in scans if scan.covariance is not None]
    if not scans or len(covariances) < len(scans):
        return None
    return np.array(covariances, np.float64).reshape(len(scans), 6, 6)


def score_survey(summary: SurveySummary, truth: Trajectory) -> dict[str, PairScore]:
    """Scores of the survey's "sequential" pairs and of all others, its "loops".

    Scans are matched with true poses by their stamps. Raises InputError: no stamp in common.
    """
    poses = {scan: truth.T_world_sensor[row] for scan, row in _by_scan(summary, truth).items()}
    chain = [pair for pair in summary.pairs if pair.role == CHAIN]
    loops = [pair for pair in summary.pairs if pair.role != CHAIN]
    return {"sequential": score_pairs(chain, poses, summary.voxel), "loops": score_pairs(loops, poses, summary.voxel)}


def calibrate_survey(summary: SurveySummary, estimate: Trajectory, truth: Trajectory) -> PoseCalibration | None:
    """Compare the errors of the poses of the estimate's component with their covariances.

    None if there are no covariances, or only a first pose. Raises InputError: no stamp in common, or the
    component's first pose, to which the covariances are relative, is missing from the estimate or from the truth.
    """
    if summary.covariances is None:
        return None
    estimate_rows = _by_scan(summary, estimate)
    truth_rows = _by_scan(summary, truth)
    first = min(estimate_rows)
    number = next((n for n, component in enumerate(summary.components) if first in component), None)
    members = [] if number is None else list(summary.components[number])
    finite = set(np.flatnonzero(np.isfinite(summary.covariances).all(axis=(1, 2))).tolist())
    common = [scan for scan in members if scan in estimate_rows and scan in truth_rows and scan in finite]
    if not common or common[0] != members[0]:
        raise InputError(
            "the first pose of the estimate's component, to which the covariances are relative, is missing from the "
            "estimate or the truth, or has no covariance; give the trajectory and the summary of the same map and a "
            "truth that holds its first pose, or leave --summary out"
        )
    return calibrate_poses(
        estimate.T_world_sensor[[estimate_rows[scan] for scan in common]],
        truth.T_world_sensor[[truth_rows[scan] for scan in common]],
        summary.covariances[np.array(common)],
        () if number is None else summary.unmeasured[number],
    )


def _by_scan(summary: SurveySummary, trajectory: Trajectory) -> dict[int, int]:
    """{index of a scan: index of its pose in the trajectory}."""
    scans, poses = associate(summary.stamps, trajectory.stamps)
    return dict(zip(scans.tolist(), poses.tolist(), strict=True))
