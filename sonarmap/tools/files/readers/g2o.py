"""Strict reader of g2o pose graphs: VERTEX_SE3:QUAT, EDGE_SE3:QUAT, EDGE_SE3_PRIOR and FIX.

A prior is a pose in the world and its information in the axes of that pose, zero in unconstrained directions.
PARAMS_SE3OFFSET, the sensor's pose on the vehicle to which priors refer, must be the identity. Other programs write
EDGE_SE3_PRIOR:QUAT, with the vertex repeated in place of the number of that offset, or without it.

The 21 numbers after an edge's quaternion are the upper triangle of its information matrix, translation first. Its
rotational part is that of a rotation vector [rad], as in GTSAM, SE-Sync and the published benchmark costs. g2o's own
solver uses the vector part of the quaternion, half the angle, so the same numbers weigh a quarter there. The format
does not define which is meant.
"""

from collections import defaultdict
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import Edge, check_definite
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.readers.clouds.rows import Line, shown
from sonarmap.tools.files.readers.instruments import LARGEST_INFORMATION
from sonarmap.tools.files.readers.trajectory import finite_rows, read_lines, transforms
from sonarmap.tools.files.user_file import naming

VERTEX, EDGE, FIX = "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "FIX"
PRIOR, PRIOR_QUAT, OFFSET = "EDGE_SE3_PRIOR", "EDGE_SE3_PRIOR:QUAT", "PARAMS_SE3OFFSET"
KNOWN = (VERTEX, EDGE, PRIOR, PRIOR_QUAT, FIX, OFFSET)
UPPER = np.triu_indices(6)
TRANSLATION_LAST = np.array([3, 4, 5, 0, 1, 2])  # permutes g2o's order of axes to ours, and back

_POSE = "x y z qx qy qz qw"
_VERTEX_LAYOUT = f"id {_POSE}"
_EDGE_LAYOUT = f"id id {_POSE} " + " ".join(f"I{i + 1}{j + 1}" for i, j in zip(*UPPER, strict=True))
_IDENTITY = np.array([0.0, 0, 0, 0, 0, 0, 1])
_LARGEST_ID = 2**53  # that is exact as a stamp, float64
_SYMBOL = 56  # bits of the number in a key of GTSAM, below those of its letter


def read_g2o(path: Path) -> PoseGraph:
    """Read a pose graph; pose k is the vertex with the k-th smallest id, and its stamp is that id, or for symbols of
    GTSAM (x0, x1, ... as 64-bit keys) the number in it. Edges between consecutive poses are "sequential", others
    "loop". Quaternions are normalized. An information matrix that is not positive definite is an InputError."""
    lines = _by_tag(path)
    if not lines[VERTEX]:
        raise InputError(f"{path} holds no {VERTEX}; a pose graph needs at least one")
    rows = finite_rows(path, lines[VERTEX], _VERTEX_LAYOUT)
    ids = [key for (key,) in _ids(path, lines[VERTEX], 1)]
    order = sorted(range(len(ids)), key=ids.__getitem__)
    for a, b in pairwise(order):
        if ids[a] == ids[b]:
            first, second = lines[VERTEX][a][0], lines[VERTEX][b][0]
            raise InputError(f"{path}: line {second} gives vertex {_named(ids[a])} again, after {first}; keep one")
    poses = transforms(path, lines[VERTEX], rows[:, 1:])[order]
    index = {ids[row]: k for k, row in enumerate(order)}
    return PoseGraph(
        Trajectory(_stamps(list(index)), poses),
        _edges(path, lines[EDGE], index),
        _fixed(path, lines[FIX], index),
        known=_known_poses(path, lines, index),
    )


def require_connected(path: Path, graph: PoseGraph) -> None:
    """Raise InputError if the graph is not connected, as its components have no common frame."""
    parts = graph.components
    if len(parts) == 1:
        return
    lines = _by_tag(path)[VERTEX]
    numbers = {key: number for (key,), (number, _) in zip(_ids(path, lines, 1), lines, strict=True)}
    first, second = (sorted(numbers)[part[0]] for part in parts[:2])
    raise InputError(
        f"{path}: line {numbers[second]}: no edges join vertex {_named(second)} to vertex {_named(first)}; join "
        f"{len(parts)} parts"
    )


def _stamps(ids: list[int]) -> np.ndarray:
    """Stamps (N,) of ascending ids; those beyond float64 become the numbers of symbols, or 0, 1, 2, ... if several
    letters have the same ones."""
    if ids[-1] <= _LARGEST_ID:
        return np.array(ids, np.float64)
    numbers = [key % 2**_SYMBOL for key in ids]
    return np.array(numbers if ids[0] >> _SYMBOL == ids[-1] >> _SYMBOL else range(len(ids)), np.float64)


def _named(key: int) -> str:
    """The id as a user knows it: x12 for the symbol of that name."""
    letter = chr(key >> _SYMBOL) if 0 <= key < 2**64 else ""
    return f"{letter}{key % 2**_SYMBOL}" if letter.isascii() and letter.isalpha() else str(key)[:60]


def _by_tag(path: Path) -> dict[str, list[Line]]:
    """The lines by tag, without the tag; EDGE_SE3_PRIOR:QUAT is converted to EDGE_SE3_PRIOR."""
    lines: dict[str, list[Line]] = defaultdict(list)
    for number, line in read_lines(path):
        tag, *rest = line.split(maxsplit=1)
        name = tag.decode("utf-8", "replace")
        if name not in KNOWN:
            raise InputError(f"{path}: line {number} begins with {shown(tag)}; known are {', '.join(KNOWN)}")
        content = rest[0] if rest else b""
        if name == PRIOR_QUAT:
            name, numbers = PRIOR, content.split()
            if len(numbers) == len(_EDGE_LAYOUT.split()) - 1:
                content = b" ".join([*numbers[:1], *numbers])
        lines[name].append((number, content))
    return lines


def _ids(path: Path, lines: list[Line], count: int) -> list[list[int]]:
    """The first `count` numbers of each line, which are ids."""
    ids = [[key_of(token) for token in line.split()[:count]] for _, line in lines]
    for (number, _), keys in zip(lines, ids, strict=True):
        if min(keys, default=-1) < 0:
            raise InputError(f"{path}: line {number}: vertex ids are whole numbers from 0 on")
    return ids


def key_of(token: bytes) -> int:
    """The id in a token, exactly; -1 for anything but a whole number."""
    with suppress(ValueError):
        if (number := float(token)).is_integer():
            return int(token) if token.isdigit() else int(number)
    return -1


def _edges(path: Path, lines: list[Line], index: dict[int, int]) -> tuple[Edge, ...]:
    if not lines:
        return ()
    ends, measured, information = _measured(path, lines)
    covariances = _covariances(path, lines, information)
    edges = []
    for (number, _), pair, T_i_j, covariance in zip(lines, ends, measured, covariances, strict=True):
        where = f"{path}: line {number}"
        i, j = (_pose_of(index, vertex, where) for vertex in pair)
        registration = Registration(T_i_j, covariance, np.nan, np.nan, True, 0.0, "read from a file")
        with naming(where):
            edges.append(Edge(i, j, registration, "sequential" if abs(i - j) == 1 else "loop"))
    return tuple(edges)


def _covariances(path: Path, lines: list[Line], information: np.ndarray) -> np.ndarray:
    """Covariances (m, 6, 6), rotation first, of information matrices (m, 6, 6) in the file's order."""
    try:
        np.linalg.cholesky(information)
        covariances = np.linalg.inv(information)
    except np.linalg.LinAlgError:  # it does not say which matrix is at fault
        for (number, _), matrix in zip(lines, information, strict=True):
            with naming(f"{path}: line {number}"):
                check_definite(matrix, "the information matrix")
        raise
    vague = np.flatnonzero(~(np.abs(covariances).max(axis=(1, 2)) <= LARGEST_INFORMATION))
    if len(vague):
        raise InputError(
            f"{path}: line {lines[vague[0]][0]}: its information is nearly zero in some direction (a variance "
            f"beyond {LARGEST_INFORMATION:g}); delete the line"
        )
    covariances = covariances[:, *np.ix_(TRANSLATION_LAST, TRANSLATION_LAST)]
    return (covariances + covariances.transpose(0, 2, 1)) / 2


def _measured(path: Path, lines: list[Line]) -> tuple[list[list[int]], RigidTransform, np.ndarray]:
    """Ids of both ends, transforms (m,) and informations (m, 6, 6), in the order of the file, of m edges or priors."""
    rows = finite_rows(path, lines, _EDGE_LAYOUT)
    ids, measured = _ids(path, lines, 2), transforms(path, lines, rows[:, 2:9])
    information = np.zeros((len(lines), 6, 6))
    information[:, *UPPER] = rows[:, 9:]
    return ids, measured, information + np.triu(information, 1).transpose(0, 2, 1)


def _known_poses(path: Path, lines: dict[str, list[Line]], index: dict[int, int]) -> tuple[KnownPose, ...]:
    """The priors of single poses."""
    if not lines[PRIOR]:
        return ()
    _require_no_offset(path, lines[OFFSET])
    ids, measured, informations = _measured(path, lines[PRIOR])
    informations = informations[:, *np.ix_(TRANSLATION_LAST, TRANSLATION_LAST)]
    known = []
    for (number, _), (vertex, _), T, information in zip(lines[PRIOR], ids, measured, informations, strict=True):
        where = f"{path}: line {number}"
        pose = _pose_of(index, vertex, where)
        with naming(where):
            known.append(KnownPose(pose, T, information))
    return tuple(known)


def _require_no_offset(path: Path, lines: list[Line]) -> None:
    for number, line in lines:
        row = finite_rows(path, [(number, line)], f"id {_POSE}")[0]
        if not np.allclose(row[1:], _IDENTITY):
            raise InputError(
                f"{path}: line {number}: priors with a sensor offset are not supported; give {OFFSET} as 0 0 0 0 0 0 1"
            )


def _fixed(path: Path, lines: list[Line], index: dict[int, int]) -> tuple[int, ...]:
    fixed = set()
    for number, line in lines:
        (ids,) = _ids(path, [(number, line)], len(line))
        fixed.update(_pose_of(index, vertex, f"{path}: line {number}") for vertex in ids)
    return tuple(sorted(fixed))


def _pose_of(index: dict[int, int], vertex: int, where: str) -> int:
    if vertex not in index:
        raise InputError(
            f"{where} names vertex {_named(vertex)}, which the file does not define; add it, or delete the line"
        )
    return index[vertex]
