"""Which scans to register besides consecutive ones, and which of the results to keep."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from slam.cell import cell_keys, lattice_origin
from slam.pose_graph import Solution
from spectral.result import Registration
from spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How eagerly loops are sought and how strictly they are judged.

    Attributes:
        per_scan: most loops that one scan takes part in; 0 seeks none.
        min_overlap: predicted overlap that makes a pair a candidate, 0..1.
        cell_voxels: edge of the cells in which overlap is predicted [voxels]: coarse, as the estimate has
            drifted.
        spread: a scan's loops lead to scans more than this apart, so that its neighbors do not take them all.
        bound: largest distance between a loop and the estimate [sigmas]; 4.74 holds 99.9 % of right ones (six
            degrees of freedom).
        floor_rotation, floor_voxels: an uncertainty that is granted in any case, added in quadrature [rad,
            voxels].
    """

    per_scan: int = 2
    min_overlap: float = 0.3
    cell_voxels: float = 4.0
    spread: int = 2
    bound: float = 4.74
    floor_rotation: float = float(np.radians(1.0))
    floor_voxels: float = 1.0

    def __post_init__(self) -> None:
        if self.per_scan < 0 or self.spread < 0:
            raise InputError(f"per_scan {self.per_scan} and spread {self.spread}: wanted 0 or more")
        if not 0 < self.min_overlap <= 1:
            raise InputError(f"min_overlap is {self.min_overlap}; wanted more than 0 and at most 1")
        if min(self.cell_voxels, self.bound) <= 0 or min(self.floor_rotation, self.floor_voxels) < 0:
            raise InputError("cell_voxels and bound have to be positive, the floors not negative")


@dataclass(frozen=True, slots=True)
class Candidate:
    """Two scans that are expected to overlap.

    Attributes:
        i, j: indices of the scans, i < j.
        overlap: predicted, 0..1.
    """

    i: int
    j: int
    overlap: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a loop's registration is kept.

    Attributes:
        kept: whether it becomes an edge.
        sigmas: its distance from the estimate (Mahalanobis); NaN where the registration itself refused it.
        reason: in words.
    """

    kept: bool
    sigmas: float
    reason: str


def predict_overlap(scans: Sequence[Scan], T_world_sensor: RigidTransform, cell: float) -> np.ndarray:
    """The share of cells that two scans have in common: (N, N) float64, 0..1, the smaller of both ways.

    Points a million cells away from the first scan, stray echoes, do not count.

    Args:
        scans: N scans.
        T_world_sensor: their poses as estimated, in one frame.
        cell: edge of a cell [m].
    """
    origin = lattice_origin(T_world_sensor[0].apply(scans[0].points.astype(np.float64)), cell)
    occupied = [
        np.unique(cell_keys(T.apply(scan.points.astype(np.float64)), cell, origin)[0])
        for scan, T in zip(scans, T_world_sensor, strict=True)
    ]
    counts = np.array([len(cells) for cells in occupied])
    names, column = np.unique(np.concatenate(occupied), return_inverse=True)
    row = np.repeat(np.arange(len(scans)), counts)
    incidence = sparse.csr_array((np.ones(len(row)), (row, column)), shape=(len(scans), len(names)))
    return (incidence @ incidence.T).toarray() / np.maximum(np.maximum(counts[:, None], counts), 1)


def find_candidates(scans: Sequence[Scan], solution: Solution, voxel: float, settings: LoopSettings) -> list[Candidate]:
    """Pairs that are not consecutive and that the estimate says overlap, best first within the limits per scan.

    Only scans of one component are compared: between components the estimate says nothing.

    Args:
        scans: N scans.
        solution: the optimized graph of their N poses.
        voxel: edge of the survey's voxels [m].
        settings: thresholds and limits.
    """
    found: list[Candidate] = []
    T_world_sensor = solution.trajectory.T_world_sensor
    for members in solution.graph.components:
        if settings.per_scan == 0 or len(members) < 3:
            continue
        chosen = np.array(members)
        overlap = predict_overlap([scans[k] for k in members], T_world_sensor[chosen], settings.cell_voxels * voxel)
        a, b = np.nonzero(np.triu(overlap >= settings.min_overlap, 1))
        found += [
            Candidate(i, j, float(share))
            for i, j, share in zip(chosen[a].tolist(), chosen[b].tolist(), overlap[a, b], strict=True)
        ]
    joined = {frozenset((edge.i, edge.j)) for edge in solution.graph.edges}
    new = [c for c in found if c.j - c.i > 1 and frozenset((c.i, c.j)) not in joined]
    return _within_limits(sorted(new, key=lambda c: (-c.overlap, c.i, c.j)), settings)


def _within_limits(ranked: list[Candidate], settings: LoopSettings) -> list[Candidate]:
    partners: dict[int, list[int]] = defaultdict(list)
    kept = []
    for candidate in ranked:
        i, j = candidate.i, candidate.j
        full = max(len(partners[i]), len(partners[j])) >= settings.per_scan
        near = [abs(j - other) for other in partners[i]] + [abs(i - other) for other in partners[j]]
        if not full and all(gap > settings.spread for gap in near):
            partners[i].append(j)
            partners[j].append(i)
            kept.append(candidate)
    return kept


def judge(
    candidate: Candidate, registration: Registration, solution: Solution, voxel: float, settings: LoopSettings
) -> Verdict:
    """Keep a loop that its registration believes in and that the estimate can be reconciled with.

    The distance is that of the measured from the estimated T_i_j under the sum of three covariances: the
    measurement's, the estimate's (joint marginal of both poses), and the floor.
    """
    if not registration.accepted:
        words = registration.reason or "no reason given"
        return Verdict(False, float("nan"), f"refused by the registration: {words}")
    T_i_j, covariance = solution.relative(candidate.i, candidate.j)
    difference = (T_i_j.inv() * registration.T_target_source).as_exp_coords()
    floor = np.repeat([settings.floor_rotation, settings.floor_voxels * voxel], 3)
    joint = covariance + registration.covariance + np.diag(floor**2)
    sigmas = float(np.sqrt(difference @ np.linalg.solve(joint, difference)))
    apart = (
        f"{sigmas:.1f} sigmas from the estimate ({np.degrees(np.linalg.norm(difference[:3])):.1f} degrees, "
        f"{np.linalg.norm(difference[3:]):.2f} m), {settings.bound:g} allowed"
    )
    if not sigmas <= settings.bound:
        return Verdict(False, sigmas, f"refused, inconsistent: {apart}")
    return Verdict(True, sigmas, f"kept: {apart}")
