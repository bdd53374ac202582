"""Readers of poses: TUM, EuRoC, KITTI and gt.log files, and a map's graph.json.

TUM has one pose per line, `stamp tx ty tz qx qy qz qw`; KITTI has the upper 3 x 4 of the pose matrix row by row, and no
stamps. A gt.log of registration benchmarks has the true transforms between numbered scans: for every pair a line `i j`,
or `i j n` with any number n, then the four rows of a 4 x 4 matrix that maps points of scan j into the frame of scan i
(http://redwood-data.org/indoor/fileformat.html).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.clouds.rows import Line, parse_rows, shown, whole_lines
from sonarmap.tools.files.readers.instruments import LARGEST, LEAST_SIGMA, largest_of
from sonarmap.tools.files.user_file import naming, read_content, read_json

LAYOUT = "stamp tx ty tz qx qy qz qw"  # of TUM
_KITTI = "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"
GT_LOG = "gt.log"
_LINES = 5  # lines per pair in a gt.log
_NUMBERS = re.compile(rb"\s*(\d{1,9})\s+(\d{1,9})(\s+\d{1,9})?\s*")
FORMAT = "sonarmap graph 1"
ORTHONORMAL = 1e-3  # largest deviation of R R^T from the identity, which rounding to few digits causes


def read_pair(estimate: Path, *truths: Path) -> tuple[Trajectory, Trajectory]:
    """Read an estimated and a true trajectory of a map. Poses correspond by stamp in TUM files, by line in KITTI files
    (with that suffix or twelve columns). The truth is one file, or one per dive in the map's order (see `in_order`)."""
    stamped = not _is_kitti(estimate)
    for truth in truths:
        if stamped == _is_kitti(truth):
            with_stamps, without = (estimate, truth) if stamped else (truth, estimate)
            raise InputError(f"{without} is a KITTI file without stamps, {with_stamps} is not; give one format")
    read = read_tum if stamped else read_kitti
    return read(estimate), in_order([read(truth) for truth in truths])


def in_order(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Concatenate trajectories in one world frame. If all have the stamps 0, 1, 2, ..., the count continues over all of
    them, as it does over a map's scans without times; other stamps are unchanged."""
    stamps = [trajectory.stamps for trajectory in trajectories]
    if all(np.array_equal(each, np.arange(len(each))) for each in stamps):
        stamps = [np.arange(sum(map(len, stamps)), dtype=np.float64)]
    poses = RigidTransform.concatenate([trajectory.T_world_sensor for trajectory in trajectories])
    return Trajectory(np.concatenate(stamps), poses)


def poses_at(trajectory: Trajectory, times: np.ndarray) -> RigidTransform:
    """Poses T_world_sensor (N,) of a trajectory of at least two poses, interpolated at times (N,) [s]."""
    known, T = trajectory.stamps, trajectory.T_world_sensor
    places = np.column_stack([np.interp(times, known, axis) for axis in T.translation.T])
    return RigidTransform.from_components(places, Slerp(known, T.rotation)(times))


def _is_kitti(path: Path) -> bool:
    return path.suffix.lower() == ".kitti" or len(read_lines(path)[0][1].split()) == len(_KITTI.split())


def read_kitti(path: Path) -> Trajectory:
    """Read the poses T_world_sensor [m] of a KITTI file, with the stamps 0, 1, 2, ... and orthonormalized rotations."""
    lines = read_lines(path)
    rows = np.hstack([finite_rows(path, lines, _KITTI), np.tile([0.0, 0, 0, 1], (len(lines), 1))])
    with naming(path):
        poses = [rigid_transform(row.reshape(4, 4), f"line {line}") for (line, _), row in zip(lines, rows, strict=True)]
    return Trajectory(np.arange(len(lines), dtype=np.float64), RigidTransform.concatenate(poses))


def read_tum(path: Path) -> Trajectory:
    """Read the stamps [s] and poses T_world_sensor [m] of a TUM file, or of a table as EuRoC has it: nanoseconds, the
    position, and the quaternion with w first."""
    lines = read_lines(path)
    if is_table := b"," in lines[0][1]:
        lines = [(number, b" ".join(line.split(b",")[:8])) for number, line in lines]
    rows = finite_rows(path, lines, LAYOUT)
    if is_table:
        rows = rows[:, [0, 1, 2, 3, 5, 6, 7, 4]] * np.append(1e-9, np.ones(7))
    return Trajectory(rows[:, 0].copy(), transforms(path, lines, rows[:, 1:]))


@dataclass(frozen=True, slots=True)
class TruePair:
    """The true transform of one pair of scans."""

    i: int  # number of the target scan
    j: int  # number of the source scan
    T_i_j: RigidTransform  # p_i = T_i_j p_j [m]
    line: int  # line of the file at which it begins


def read_gt_log(path: Path) -> tuple[TruePair, ...]:
    """Read all pairs of a gt.log file, in its order."""
    lines = read_lines(path)
    starts = range(0, len(lines), _LINES)
    pairs = [_pair(path, lines[start : start + _LINES]) for start in starts]
    known: dict[frozenset[int], TruePair] = {}
    for pair in pairs:
        before = known.setdefault(frozenset((pair.i, pair.j)), pair)
        if before is not pair:
            raise InputError(
                f"{path}: lines {before.line} and {pair.line} are both for the scans {pair.i} and {pair.j}; delete one"
            )
    return tuple(pairs)


def _pair(path: Path, block: list[Line]) -> TruePair:
    number, text = block[0]
    match = _NUMBERS.fullmatch(text)
    if match is None:
        raise InputError(f"{path}: line {number} is {shown(text)}; wanted two scans, as 0 1, above a matrix")
    i, j = int(match[1]), int(match[2])
    if i == j:
        raise InputError(f"{path}: line {number} pairs the scan {i} with itself; wanted two scans; delete that pair")
    if len(block) < _LINES:
        raise InputError(f"{path}: the pair in line {number} has {len(block) - 1} rows; wanted four: copy it again")
    matrix = finite_rows(path, block[1:], "r r r t")
    with naming(path):
        T_i_j = rigid_transform(matrix, f"the pair in line {number}")
    return TruePair(i, j, T_i_j, number)


def read_graph_json(path: Path) -> PoseGraph:
    """Read the pose graph of a map: poses, edges, priors and control points."""
    content = read_json(path, "the graph.json of a map")
    try:
        if content["format"] != FORMAT:
            raise InputError(f"{path} is of format {content['format']!r}; wanted {FORMAT!r}")
        trajectory = trajectory_of(content["poses"])
        edges = tuple(_edge(row) for row in content["edges"])
        priors = tuple((int(row["pose"]), _prior(row)) for row in content["priors"])
        control = tuple(_control(row) for row in content.get("control_points", ()))
        return PoseGraph(trajectory, edges, priors=priors, control=control)
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"{path} is not the graph.json of a map ({error})") from error


def trajectory_of(poses: Any) -> Trajectory:
    """The trajectory of the list `poses` of a graph.json."""
    T = RigidTransform.concatenate([rigid_transform(pose["T_world_sensor"], "a pose") for pose in poses])
    return Trajectory(np.array([pose["stamp"] for pose in poses], dtype=np.float64), T)


def _edge(row: dict[str, Any]) -> Edge:
    T = rigid_transform(row["T_i_j"], "an edge")
    probability = np.nan if row["probability"] is None else float(row["probability"])
    covariance = np.array(row["covariance"])
    measured = Registration(T, covariance, np.nan, np.nan, True, 0.0, str(row["reason"]), probability)
    return Edge(int(row["i"]), int(row["j"]), measured, row["kind"])


def _control(row: dict[str, Any]) -> ControlPoint:
    point, known, sigmas = (np.array(row[name], dtype=np.float64) for name in ("point", "known", "sigmas"))
    return ControlPoint(str(row["name"]), int(row["pose"]), point, known, sigmas)


def _prior(row: dict[str, Any]) -> PosePrior:
    sigmas = np.array([np.inf if sigma is None else sigma for sigma in row["sigmas"]], dtype=np.float64)
    if not (sigmas >= LEAST_SIGMA).all():
        raise InputError(f"a prior has the standard deviation {sigmas.min():g}; wanted at least {LEAST_SIGMA:g}")
    return PosePrior(rigid_transform(row["T_world_sensor"], "a prior"), sigmas)


def read_lines(path: Path) -> list[Line]:
    """The lines of a file that are neither blank nor comments (#), with their line numbers."""
    content = read_content(Path(path))
    with naming(path):
        lines = [line for line in whole_lines(content, 1) if not line[1].lstrip().startswith(b"#")]
    if not lines:
        raise InputError(f"{path} holds no line but comments; wanted poses")
    return lines


def finite_rows(path: Path, lines: list[Line], layout: str) -> np.ndarray:
    """The finite numbers (N, C) float64 of lines; `layout` names the C columns, separated by blanks."""
    try:
        rows = parse_rows(lines, len(layout.split()))
    except InputError as error:
        raise InputError(f"{path}: {error}. Each holds: {layout}") from error
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: line {lines[bad[0]][0]} holds NaN or infinity; wanted finite numbers: {layout}")
    largest = np.array([largest_of(column) for column in layout.split()])
    beyond = np.argwhere(np.abs(rows) > largest)
    if len(beyond):
        row, column = beyond[0].tolist()
        raise InputError(
            f"{path}: line {lines[row][0]} holds {rows[row, column]:g}; wanted {layout.split()[column]} within "
            f"{largest[column]:g}: fix that line"
        )
    return rows


def transforms(path: Path, lines: list[Line], rows: np.ndarray) -> RigidTransform:
    """Rigid transforms of rows (N, 7): x y z [m] and a quaternion x y z w, which is normalized."""
    zero = np.flatnonzero(np.linalg.norm(rows[:, 3:], axis=1) < LEAST_SIGMA)
    if len(zero):
        raise InputError(f"{path}: line {lines[zero[0]][0]} holds a zero quaternion; write 0 0 0 1 for no rotation")
    return RigidTransform.from_components(rows[:, :3], Rotation.from_quat(rows[:, 3:]))


def rigid_transform(rows: Any, what: str) -> RigidTransform:
    """The rigid transform of a matrix (4, 4), with the nearest rotation; `what` is named in errors."""
    matrix = np.array(rows, np.float64)
    if matrix.shape != (4, 4):
        raise InputError(f"the matrix of {what} has shape {matrix.shape}; wanted (4, 4)")
    bad = matrix[~(np.abs(matrix) <= LARGEST)]  # NaN too
    if len(bad):
        raise InputError(f"the matrix of {what} holds {bad[0]:g}; wanted numbers within {LARGEST:g}")
    R = matrix[:3, :3]
    off = np.abs(R @ R.T - np.eye(3)).max()
    # a cross product gives the determinant's sign; np.linalg.det divides by pivots, which may be tiny
    if off > ORTHONORMAL or np.cross(R[0], R[1]) @ R[2] < 0 or not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(f"the matrix of {what} is not a rigid transform: its rotation is off by {off:.2g}")
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]))
