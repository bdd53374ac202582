"""Errors of registered pairs and of trajectories against the truth.

Angles in results are in degrees, and their names say so.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory

ARM = 1.0  # 1 rad of an orientation error weighs as much as this length [m]
LINE_RATIO = 1e-3  # positions with a smaller ratio of spread across to along their line fix no rotation about it


def align_poses(source: RigidTransform, target: RigidTransform) -> RigidTransform:
    """Least-squares T_target_source between N corresponding poses, N >= 1.

    With positions p_i, q_i and orientations P_i, Q_i of target and source it minimizes, over R and t,

        sum |p_i - (R q_i + t)|^2 + (ARM^2 / 2) sum ||P_i - R Q_i||_F^2,

    squared distances and squared chordal distances (about 2 angle^2; Hartley et al., DOI 10.1007/s11263-012-0601-0), in
    closed form as Umeyama's without scale (DOI 10.1109/34.88573): orientations add to the positions' correlation
    matrix. A straight line or a single pose suffices.
    """
    p, q = target.translation, source.translation
    middle_p, middle_q = p.mean(axis=0), q.mean(axis=0)
    turns = np.einsum("nij,nkj->ik", target.rotation.as_matrix(), source.rotation.as_matrix())
    U, _, Vt = np.linalg.svd((p - middle_p).T @ (q - middle_q) + ARM**2 / 2 * turns)
    R = Rotation.from_matrix(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
    return RigidTransform.from_components(middle_p - R.apply(middle_q), R)


def align_positions(source: np.ndarray, target: np.ndarray) -> RigidTransform:
    """Least-squares T_target_source between corresponding positions (N, 3) [m], N >= 3 (Umeyama, DOI
    10.1109/34.88573). Raises InputError: fewer than three positions, or positions on one line."""
    spread = [np.linalg.svd(points - points.mean(axis=0), compute_uv=False) for points in (source, target)]
    if len(source) < 3 or any(values[1] <= LINE_RATIO * values[0] for values in spread):
        raise InputError(
            f"{len(source)} common positions on one line fix no alignment; wanted three or more that do not "
            "lie on a line, or the alignment 'first'"
        )
    middle_source, middle_target = source.mean(axis=0), target.mean(axis=0)
    rotation = Rotation.align_vectors(target - middle_target, source - middle_source)[0]
    return RigidTransform.from_components(middle_target - rotation.apply(middle_source), rotation)


Alignment = Literal["poses", "positions", "first"]

STAMP_TOLERANCE = 0.01  # [s]

RIGHT_DEG = 6.0  # largest rotation error of a right registration [degrees]
RIGHT_VOXELS = 3.0  # largest translation error of a right registration, in voxels of its grid


@dataclass(frozen=True, slots=True)
class PairError:
    """Error of an estimated transform."""

    rotation_deg: float  # angle between the estimated and the true rotation [degrees], 0..180
    translation_m: float  # distance between the translations [m]

    def within(self, rotation_deg: float, translation_m: float) -> bool:
        """Whether both errors are at most the given ones."""
        return self.rotation_deg <= rotation_deg and self.translation_m <= translation_m

    def is_right(self, voxel: float) -> bool:
        """Whether a registration with this error is right, on a grid of voxels of this edge [m]."""
        return self.within(RIGHT_DEG, RIGHT_VOXELS * voxel)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A trajectory compared with the truth: N poses with a stamp in common."""

    alignment: Alignment
    T_truth_estimate: RigidTransform  # the alignment, from the estimate's world to the truth's
    stamps: np.ndarray  # (N,) [s], the estimate's, ascending
    T_aligned: RigidTransform  # N poses of the estimate after alignment, T_truth_sensor
    T_true: RigidTransform  # N poses of the truth, T_truth_sensor
    rotation_deg: np.ndarray  # (N,) error of every pose after alignment [degrees]
    translation_m: np.ndarray  # (N,) error of every position after alignment [m]; the ATE is their root mean square
    step_rotation_deg: np.ndarray  # (N - 1,) RPE: error of the motion between consecutive common poses [degrees]
    step_translation_m: np.ndarray  # (N - 1,) RPE: error of the translation of that motion [m]
    unmatched_estimates: int  # number of poses of the estimate without a pose of the truth
    unmatched_truths: int  # number of poses of the truth without a pose of the estimate

    @property
    def ate_m(self) -> float:
        """Absolute trajectory error: root mean square of the positions' errors [m]."""
        return _rms(self.translation_m)

    def to_json(self) -> dict[str, Any]:
        """All fields in JSON types; errors as root mean square, median and maximum."""
        columns = {
            "stamp": self.stamps,
            "translation_m": self.translation_m,
            "rotation_deg": self.rotation_deg,
            "estimated_m": self.T_aligned.translation,
            "true_m": self.T_true.translation,
            "estimated_yaw_deg": yaw_deg(self.T_aligned),
            "true_yaw_deg": yaw_deg(self.T_true),
        }
        return {
            "alignment": self.alignment,
            "T_truth_estimate": self.T_truth_estimate.as_matrix().tolist(),
            "poses": len(self.stamps),
            "unmatched_estimates": self.unmatched_estimates,
            "unmatched_truths": self.unmatched_truths,
            "ate_m": _statistics(self.translation_m),
            "ate_deg": _statistics(self.rotation_deg),
            "rpe_m": _statistics(self.step_translation_m),
            "rpe_deg": _statistics(self.step_rotation_deg),
            "per_pose": [
                dict(zip(columns, row, strict=True))
                for row in zip(*(column.tolist() for column in columns.values()), strict=True)
            ],
        }

    def beyond(self, translation_m: float, rotation_deg: float) -> np.ndarray:
        """Indices of the poses whose error exceeds `translation_m` or `rotation_deg`."""
        return np.flatnonzero((self.translation_m > translation_m) | (self.rotation_deg > rotation_deg))


def pair_error(T_estimate: RigidTransform, T_truth: RigidTransform) -> PairError:
    """Rotation and translation error of an estimated T_target_source."""
    rotation = (T_truth.rotation.inv() * T_estimate.rotation).magnitude()
    distance = np.linalg.norm(T_estimate.translation - T_truth.translation)
    return PairError(float(np.rad2deg(rotation)), float(distance))


def evaluate(estimate: Trajectory, truth: Trajectory, alignment: Alignment = "poses") -> Evaluation:
    """Errors of a trajectory against the truth, after one rigid alignment, without scale.

    The alignment is least squares over all common "poses" or "positions", or maps the "first" common pose onto its
    truth, so that the error of that pose shifts and turns all others. Errors of steps do not depend on it. Raises
    InputError: no stamp in common; with "positions", too few of them or all on one line.
    """
    estimate_rows, truth_rows = associate(estimate.stamps, truth.stamps)
    estimated, true = estimate.T_world_sensor[estimate_rows], truth.T_world_sensor[truth_rows]
    if alignment == "poses":
        T_truth_estimate = align_poses(estimated, true)
    elif alignment == "positions":
        T_truth_estimate = align_positions(estimated.translation, true.translation)
    else:
        T_truth_estimate = true[0] * estimated[0].inv()
    aligned = T_truth_estimate * estimated
    error = true.inv() * aligned
    step_rotation, step_translation = np.empty(0), np.empty(0)
    if len(estimate_rows) > 1:
        steps = (true[:-1].inv() * true[1:]).inv() * (estimated[:-1].inv() * estimated[1:])
        step_rotation, step_translation = steps.rotation.magnitude(), np.linalg.norm(steps.translation, axis=1)
    return Evaluation(
        alignment=alignment,
        T_truth_estimate=T_truth_estimate,
        stamps=estimate.stamps[estimate_rows],
        T_aligned=aligned,
        T_true=true,
        rotation_deg=np.rad2deg(error.rotation.magnitude()),
        translation_m=np.linalg.norm(error.translation, axis=1),
        step_rotation_deg=np.rad2deg(step_rotation),
        step_translation_m=step_translation,
        unmatched_estimates=len(estimate) - len(estimate_rows),
        unmatched_truths=len(truth) - len(truth_rows),
    )


def associate(
    estimate: np.ndarray, truth: np.ndarray, tolerance: float = STAMP_TOLERANCE
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (K,), (K,) of the matching stamps of (M,) and (N,) [s], in the order of the estimate's stamps.

    The closest stamps match first, each once. Raises InputError: no two stamps lie within the tolerance [s].
    """
    trees = (KDTree(stamps[:, None]) for stamps in (estimate, truth))
    # the search rounds distances: it goes a little farther, and the exact tolerance is applied afterwards
    near = next(trees).sparse_distance_matrix(next(trees), 1.01 * tolerance + 1e-6, p=1, output_type="ndarray")
    near = near[near["v"] <= tolerance]
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for i, j in near[np.lexsort((near["j"], near["i"], near["v"]))][["i", "j"]].tolist():
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    if not pairs:
        raise InputError(
            f"no stamp of the estimate ({_span(estimate)}) lies within {tolerance:g} s of one of the truth "
            f"({_span(truth)}); give trajectories of the same scans, or a larger tolerance"
        )
    chosen = np.array(sorted(pairs, key=lambda i: (estimate[i], i)))
    return chosen, np.array([pairs[i] for i in chosen.tolist()])


def yaw_deg(T_world_sensor: RigidTransform) -> np.ndarray:
    """(N,) yaw of N poses [degrees], as docs/conventions.md defines it."""
    forward = T_world_sensor.rotation.as_matrix()[:, :, 0]
    return np.rad2deg(np.arctan2(forward[:, 1], forward[:, 0]))


def _span(stamps: np.ndarray) -> str:
    return f"{stamps.min():.6f} to {stamps.max():.6f} s"


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _statistics(errors: np.ndarray) -> dict[str, float] | None:
    """Statistics of N errors; None without errors (the steps of a single pose)."""
    if len(errors) == 0:
        return None
    return {"rms": _rms(errors), "median": float(np.median(errors)), "max": float(errors.max())}
