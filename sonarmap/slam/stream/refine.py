"""Registrations of the scans between key scans, without an expected pose: to the nearer key scan, and to the other one
if that is refused."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared_beyond

_AGREE_SIGMAS = float(np.sqrt(chi_squared_beyond(1e-3, 6)))  # most between two poses of a scan that agree
_JUMP = 6.0  # least deviation of a jump from the motion between its neighbors [usual deviations]
_TO_SIGMA = 1.4826  # from a median absolute deviation to a standard deviation
_MAX_SPEED = 2.0  # from the scan before a jump to the one after it [median speeds]
_MAX_ROUNDS = 50  # of leaving out the scans that deviate most


@dataclass(frozen=True, slots=True)
class Between:
    scan: int  # between two key scans
    step: Edge  # from the key scan before it, by a steady motion or dead reckoning
    after: int  # the key scan after it
    T_keys: RigidTransform | None  # pose of the key scan after in the frame of the one before; None if unknown

    def candidates(self) -> tuple[Candidate, Candidate]:
        """The pairs with both key scans, the nearer one first."""
        sides = Candidate(self.step.i, self.scan, "sequential"), Candidate(self.scan, self.after, "sequential")
        return sides if self.scan - self.step.i <= self.after - self.scan else (sides[1], sides[0])


@dataclass(frozen=True, slots=True)
class Refined:
    """Edges between scans and key scans.

    Attributes:
        edges: by scan, its accepted registrations that agree with others; for a scan without them, its step.
        left: the scans without such a registration.
        registered: all registered pairs, by their scans.
    """

    edges: dict[int, list[Edge]]
    left: list[int]
    registered: dict[tuple[int, int], RegisteredPair]


def refine(runner: PairRunner, scans: Sequence[Between], floor: np.ndarray) -> Refined:
    """Register the scans to key scans; a scan without a usable registration keeps its step.

    An accepted registration is used if it agrees with the step or with the registration to the other key scan.

    Args:
        floor: (6,) standard deviations added to the difference of two poses [rad, m].
    """
    first = {pair.scans: pair for pair in runner.register([scan.candidates()[0] for scan in scans])}
    agreed = {scan.scan: _agreeing(scan, first, floor) for scan in scans}
    more = [scan.candidates()[1] for scan in scans if not agreed[scan.scan]]
    both = first | {pair.scans: pair for pair in runner.register(more)}
    edges: dict[int, list[Edge]] = {}
    for scan in scans:
        edges[scan.scan] = agreed[scan.scan] or _agreeing(scan, both, floor) or [scan.step]
    return Refined(edges, [scan.scan for scan in scans if edges[scan.scan][0] is scan.step], both)


def without_jumps(
    runner: PairRunner,
    scans: Sequence[Between],
    refined: Refined,
    keys: Mapping[int, RigidTransform],
    times: np.ndarray,
    runs: np.ndarray,
    floor: np.ndarray,
) -> Refined:
    """Replace the edges of scans that jump away from the motion between their neighbors: by the registration to the
    other key scan if that agrees with this motion, else by an edge to where the motion has the scan.

    Args:
        runner: of all N scans.
        keys: poses of the key scans.
        times: (N,) [s].
        runs: (N,) equal for consecutive scans of one component; negative for scans without a pose.
    """
    poses = dict(keys)
    for scan in scans:
        edge = refined.edges[scan.scan][0]
        T_i_j = edge.registration.T_target_source
        poses[scan.scan] = poses[edge.i] * T_i_j if edge.j == scan.scan else poses[edge.j] * T_i_j.inv()
    chosen = np.array([k for k in sorted(poses) if runs[k] >= 0])
    if not len(chosen):
        return refined
    T_chosen = RigidTransform.concatenate([poses[k] for k in chosen.tolist()])
    jumps = find_jumps(T_chosen, times[chosen], runs[chosen], np.isin(chosen, list(keys)), floor)
    by_scan, edges = {scan.scan: scan for scan in scans}, dict(refined.edges)
    jumping = [by_scan[k] for k in chosen[jumps.scans].tolist()]
    new = [c for scan in jumping for c in scan.candidates() if c.scans not in refined.registered]
    registered = refined.registered | {pair.scans: pair for pair in runner.register(new)}
    left = set(refined.left)
    for scan, T_steady, sigmas, back in zip(jumping, jumps.T, jumps.sigmas, jumps.back, strict=True):
        T_key = poses[scan.step.i]
        steady = replace(scan.step.registration, T_target_source=T_key.inv() * T_steady, covariance=np.diag(sigmas**2))
        moved = replace(scan, step=replace(scan.step, registration=steady))
        # after a jump back, two registrations to similar places can agree and both be wrong
        accepted = _near_step(moved, registered, floor) if back else _agreeing(moved, registered, floor)
        # keep the step too: a registration with a large covariance agrees with it but may pull the scan away
        edges[scan.scan] = [*accepted, moved.step] if back or not accepted else accepted
        left |= set() if accepted else {scan.scan}
    return Refined(edges, sorted(left), registered)


def _agreeing(between: Between, registered: Mapping[tuple[int, int], RegisteredPair], floor: np.ndarray) -> list[Edge]:
    """Both registrations of a scan if they agree with each other, else the first that agrees with its step."""
    edges, poses = _accepted(between, registered)
    if len(edges) == 2 and _agree(poses[0], poses[1], floor):
        return edges
    return _near_step(between, registered, floor)[:1]


def _near_step(between: Between, registered: Mapping[tuple[int, int], RegisteredPair], floor: np.ndarray) -> list[Edge]:
    """The accepted registrations of a scan that agree with its step."""
    step = between.step.registration.T_target_source, between.step.registration.covariance
    return [edge for edge, pose in zip(*_accepted(between, registered), strict=True) if _agree(step, pose, floor)]


def _accepted(
    between: Between, registered: Mapping[tuple[int, int], RegisteredPair]
) -> tuple[list[Edge], list[tuple[RigidTransform, np.ndarray]]]:
    """The accepted registrations of a scan, and its poses by them in the frame of the key scan before it, with
    covariances, body tangent."""
    edges: list[Edge] = []
    poses: list[tuple[RigidTransform, np.ndarray]] = []
    for candidate in between.candidates():
        pair = registered.get(candidate.scans)
        if pair is None or pair.registration is None or not pair.accepted:
            continue
        pose = pair.registration.T_target_source, pair.registration.covariance
        if pair.i == between.scan:  # this is the pose of the key scan after it, in the scan's frame
            if between.T_keys is None:
                continue
            pose = between.T_keys * pose[0].inv(), propagated(*pose)
        poses.append(pose)
        edges.append(Edge(*pair.scans, pair.registration, "sequential"))
    return edges, poses


def _agree(a: tuple[RigidTransform, np.ndarray], b: tuple[RigidTransform, np.ndarray], floor: np.ndarray) -> bool:
    """Whether two poses of a scan agree within their covariances, body tangent, and the floor."""
    difference = np.asarray((a[0].inv() * b[0]).as_exp_coords())
    return bool(lengths(difference[None], (a[1] + b[1] + np.diag(floor**2))[None])[0] <= _AGREE_SIGMAS)


@dataclass(frozen=True, slots=True)
class Jumps:
    """Scans that jump away from the motion between their neighbors.

    Attributes:
        scans: (n,) int, ascending.
        T: n poses that the motion between their neighbors gives them.
        sigmas: (n, 6) standard deviations of these poses [rad, m].
        back: (n,) bool, whether the scan after the jump is back within usual reach of the scan before it.
    """

    scans: np.ndarray
    T: RigidTransform
    sigmas: np.ndarray
    back: np.ndarray


def find_jumps(T: RigidTransform, times: np.ndarray, runs: np.ndarray, fixed: np.ndarray, floor: np.ndarray) -> Jumps:
    """Find the scans that deviate far from a steady motion between the scans before and after them.

    Args:
        times: (N,) [s], ascending within a run.
        runs: (N,) equal for consecutive scans of one component.
        fixed: (N,) bool, scans whose poses are taken as right.
        floor: (6,) lower bound of the usual deviation [rad, m].
    """
    kept: np.ndarray = np.arange(len(times))
    if len(kept) < 3:
        return Jumps(kept[:0], T[kept[:0]], np.zeros((0, 6)), np.zeros(0, bool))
    deviations = _deviations(T, times, kept)
    inside = runs[kept[:-2]] == runs[kept[2:]]
    usual = np.maximum(_TO_SIGMA * np.median(np.abs(deviations[inside]), axis=0), floor) if inside.any() else floor
    step = float(np.median(np.diff(times)[np.diff(runs) == 0])) if inside.any() else 1.0
    for _ in range(_MAX_ROUNDS):
        far = np.linalg.norm(_deviations(T, times, kept) / usual, axis=1)
        # over a longer time between neighbors the motion may be less steady
        far /= np.maximum((times[kept[2:]] - times[kept[:-2]]) / (2 * step), 1.0)
        far = np.pad(np.where((runs[kept[:-2]] == runs[kept[2:]]) & ~fixed[kept[1:-1]], far, 0.0), 1)
        jumping = (far > _JUMP) & (far >= np.roll(far, 1)) & (far >= np.roll(far, -1))
        if not jumping.any() or len(kept) - jumping.sum() < 3:
            break
        kept = kept[~jumping]
    gone = np.setdiff1d(np.arange(len(times)), kept)
    following = np.searchsorted(kept, gone)
    before, after = kept[following - 1], kept[following]
    longer = np.maximum((times[after] - times[before]) / (2 * step), 1.0)
    distances, spans = _distances(T, before, after), times[after] - times[before]
    same = np.flatnonzero(np.diff(runs) == 0)
    speeds = np.median(_distances(T, same, same + 1) / np.maximum(np.diff(times)[same, None], 1e-9), axis=0)
    most = _MAX_SPEED * speeds * spans[:, None] + _JUMP * np.linalg.norm(usual.reshape(2, 3), axis=1)
    return Jumps(gone, _steady(T, times, before, gone, after), longer[:, None] * usual, (distances <= most).all(axis=1))


def _distances(T: RigidTransform, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(n, 2) distances between poses [rad, m]."""
    apart = T[i].inv() * T[j]
    return np.column_stack([apart.rotation.magnitude(), np.linalg.norm(apart.translation, axis=1)])


def _deviations(T: RigidTransform, times: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(n - 2, 6) deviations of the kept scans, but the first and the last, from the motion between their neighbors."""
    steady = _steady(T, times, kept[:-2], kept[1:-1], kept[2:])
    return np.asarray((steady.inv() * T[kept[1:-1]]).as_exp_coords())


def _steady(
    T: RigidTransform, times: np.ndarray, before: np.ndarray, at: np.ndarray, after: np.ndarray
) -> RigidTransform:
    """Poses at the times of scans `at`, interpolated by a steady motion between the scans before and after."""
    share = (times[at] - times[before]) / np.maximum(times[after] - times[before], 1e-9)
    motion = np.asarray((T[before].inv() * T[after]).as_exp_coords())
    return T[before] * RigidTransform.from_exp_coords(share[:, None] * motion)
