"""Writers of trajectories as TUM and of pose graphs as g2o, in full float64 precision.

TUM has a pose per line, `stamp tx ty tz qx qy qz qw`. The g2o conventions are in `readers.g2o`.
"""

from codecs import BOM_UTF8
from collections.abc import Container, Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.edge import inverse_definite
from sonarmap.slam.graph.known_pose import KnownPose
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.g2o import EDGE, FIX, OFFSET, PRIOR, TRANSLATION_LAST, UPPER, VERTEX, key_of
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path

HEADER = "# stamp [s] tx ty tz [m] qx qy qz qw: T_world_sensor\n"


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write the stamps and poses T_world_sensor of a trajectory to a TUM file."""
    poses = (" ".join(f"{x:.17g}" for x in pose) for pose in pose_numbers(trajectory.T_world_sensor).tolist())
    # repr is the shortest text that reads back as the same float64, so stamps keep their microseconds
    rows = [f"{stamp!r} {pose}\n" for stamp, pose in zip(trajectory.stamps.tolist(), poses, strict=True)]
    with atomic_path(path) as temporary:
        temporary.write_text("".join([HEADER, *rows]))


def pose_numbers(T: RigidTransform) -> np.ndarray:
    """Numbers (N, 7) float64 of N transforms: x y z [m] and the quaternion x y z w, w >= 0."""
    return np.hstack([T.translation, T.rotation.as_quat(canonical=True)])


def write_g2o(path: Path, graph: PoseGraph, left_out: Container[int] = ()) -> None:
    """Write a pose graph to a g2o file: poses, fixed poses, priors of single poses (EDGE_SE3_PRIOR) and edges. Vertex k
    is pose k; poses in `left_out` are not written. Translations are exact, quaternions and covariances (which are
    inverted) exact to rounding. The format has no stamps."""
    prior = next((edge for edge in graph.edges if edge.kind == "prior"), None)
    if prior is not None:
        raise InputError(f"edge {prior.name} is a prior, which {EDGE} cannot hold; give it as a `KnownPose`")
    poses = pose_numbers(graph.trajectory.T_world_sensor).tolist()
    lines = [_line(f"{VERTEX} {k}", pose) for k, pose in enumerate(poses) if k not in left_out]
    lines += [f"{FIX} {pose}\n" for pose in graph.fixed]
    lines += _known_lines([known for known in graph.gauge.all_known if known.pose not in left_out])
    if graph.edges:
        stacked = RigidTransform.concatenate([edge.registration.T_target_source for edge in graph.edges])
        for edge, pose in zip(graph.edges, pose_numbers(stacked).tolist(), strict=True):
            information = inverse_definite(edge.registration.covariance)
            lines.append(_line(f"{EDGE} {edge.i} {edge.j}", [*pose, *_upper(information)]))
    with atomic_path(path) as temporary:
        temporary.write_text("".join(lines))


def rewrite_g2o(
    path: Path,
    source: Path,
    trajectory: Trajectory,
    left_out: Container[int] = (),
) -> None:
    """Copy the g2o file `source` with new poses; all else, including comments and the digits of edges, is unchanged.
    `trajectory` has the poses of its vertices in the order of their ids, as `read_g2o` returns them. Edges are numbered
    from 0 in the file's order: those in `left_out` are dropped."""
    tagged = [
        (line.split(maxsplit=2)[:2], line) for line in read_content(Path(source)).removeprefix(BOM_UTF8).splitlines()
    ]
    ids = sorted(key_of(words[1]) for words, _ in tagged if words[:1] == [VERTEX.encode()])
    poses = dict(zip(ids, pose_numbers(trajectory.T_world_sensor).tolist(), strict=True))
    lines, edges = [], 0
    for words, line in tagged:
        if words[:1] == [VERTEX.encode()]:
            lines.append(_line(f"{VERTEX} {words[1].decode()}", poses[key_of(words[1])]).encode())
            continue
        if words[:1] == [EDGE.encode()]:
            edges += 1
            if edges - 1 in left_out:
                continue
        lines.append(line + b"\n")
    with atomic_path(path) as temporary:
        temporary.write_bytes(b"".join(lines))


def _known_lines(known: Sequence[KnownPose]) -> list[str]:
    """Lines of priors of single poses, preceded by the identity as the sensor offset to which they refer."""
    if not known:
        return []
    poses = pose_numbers(RigidTransform.concatenate([prior.T_world_pose for prior in known])).tolist()
    lines = [f"{OFFSET} 0 0 0 0 0 0 0 1\n"]
    for prior, pose in zip(known, poses, strict=True):
        lines.append(_line(f"{PRIOR} {prior.pose} 0", [*pose, *_upper(prior.information)]))
    return lines


def _upper(information: np.ndarray) -> list[float]:
    """The 21 numbers of the upper triangle of an information matrix (6, 6), in g2o's order."""
    return information[np.ix_(TRANSLATION_LAST, TRANSLATION_LAST)][UPPER].tolist()


def _line(head: str, numbers: Iterable[float]) -> str:
    return f"{head} {' '.join(f'{number:.17g}' for number in numbers)}\n"
