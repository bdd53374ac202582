"""The scans between key scans: registered to these, or placed by the motion from one key scan to the next, which strays
from a steady one as the key scans themselves show it."""

from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.decision import Decision
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.wrong_control import WrongControl, without_wrong_control
from sonarmap.slam.decide.wrong_measurements import JudgedFixes, judge_fixes
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.place import place_by_control, place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.motion import scan_times
from sonarmap.slam.stream.refine import Between, Refined, refine, without_leaps
from sonarmap.spectral.result import Registration


def with_between(
    decision: Decision,
    keys: Sequence[int],
    measurements: Measurements,
    floor: np.ndarray,
    runner: PairRunner,
    odd: Collection[int] = (),
) -> Decision:
    """What was decided about key scans, for all scans.

    A scan between two key scans is registered to one of them, or both. Where no registration can be believed, it is
    where dead reckoning has it from the first, or where a steady motion from one to the other passes at its time. It
    takes part in the graph by that, and by what instruments measured of it.

    Args:
        decision: about the key scans, numbered 0, 1, ...; `keys` are their indices among all scans, ascending.
        floor: (6,) standard deviations of a place that is interpolated [rad, m].
        odd: scans without a place, which are left alone.
    """
    count, graph = len(measurements.scans), decision.solution.graph
    between = _between(keys, decision, measurements, floor, odd)
    refined = _refined(between, keys, decision, measurements, floor, runner)
    edges = [_measured(edge) for own in refined.edges.values() for edge in own]
    interpolated = tuple(refined.left)
    del refined  # with all that was registered
    at_keys = {k: number for number, k in enumerate(keys)}

    def expanded(T_keys: RigidTransform) -> Trajectory:
        poses = dict.fromkeys(odd, RigidTransform.identity()) | {k: T_keys[n] for k, n in at_keys.items()}
        for each in between:
            poses[each.scan] = poses[each.step.i] * each.step.registration.T_target_source
        return Trajectory(measurements.stamps, RigidTransform.concatenate([poses[k] for k in range(count)]))

    kept = [replace(edge, i=keys[edge.i], j=keys[edge.j]) for edge in graph.edges]
    whole = PoseGraph(expanded(graph.trajectory.T_world_sensor), (*kept, *edges))
    solution, judged, wrong_control = _solved(whole, keys, decision, measurements)
    pairs = tuple(pair.renumbered(dict(enumerate(keys))) for pair in decision.pairs)
    fixes = {(fix.scan, fix.kind): fix for fix in judged.wrong}
    fixes |= {(keys[fix.scan], fix.kind): replace(fix, scan=keys[fix.scan]) for fix in decision.fixes.wrong}
    chained = expanded(decision.chained.T_world_sensor)
    judged = replace(judged, wrong=tuple(fixes[key] for key in sorted(fixes)))
    displaced = tuple((keys[i], keys[j]) for i, j in decision.displaced)
    return Decision(chained, solution, pairs, judged, wrong_control, decision.drifts, displaced, interpolated)


def _solved(
    whole: PoseGraph, keys: Sequence[int], decision: Decision, measurements: Measurements
) -> tuple[Solution, JudgedFixes, tuple[WrongControl, ...]]:
    """The optimum of the graph of all scans, by the fixes and control points that are right; and which are not."""
    if set(measurements.priors) - set(keys):
        # fixes of scans between may be all that ties the map to the world
        whole = replace(whole, trajectory=place_in_world(whole.trajectory, whole.components, measurements.priors))
        judged = judge_fixes(whole, measurements.priors)
    else:
        judged = replace(decision.fixes, priors={keys[k]: prior for k, prior in decision.solution.graph.priors})
    measured = tuple(sorted(judged.priors.items()))
    control, wrong_control = _control(decision, keys, measurements)
    if control:
        # points of scans between may be all that ties the map to the world
        placed = place_by_control(whole.trajectory, whole.components, control, judged.priors)
        whole = replace(whole, trajectory=placed, control=control)
        control, more_wrong = without_wrong_control(replace(whole, priors=measured))
        whole, wrong_control = replace(whole, control=control), (*wrong_control, *more_wrong)
    solution = replace(whole, priors=measured).optimize()
    solution = replace(
        solution,
        chi_squared_before=decision.solution.chi_squared_before,
        degrees_of_freedom=decision.solution.degrees_of_freedom,
    )
    return solution, judged, wrong_control


def _refined(
    between: Sequence[Between],
    keys: Sequence[int],
    decision: Decision,
    measurements: Measurements,
    floor: np.ndarray,
    runner: PairRunner,
) -> Refined:
    """How the scans between lie to key scans, without leaps."""
    graph = decision.solution.graph
    parts = {keys[k]: n for n, members in enumerate(graph.components) for k in members}
    at = {k: decision.solution.trajectory.T_world_sensor[n] for n, k in enumerate(keys)}
    times = scan_times(measurements.stamps, measurements.surveys)
    runs = _runs(parts, between, measurements.surveys)
    return without_leaps(runner, between, refine(runner, between, floor), at, times, runs, floor)


def _measured(edge: Edge) -> Edge:
    """An edge with what takes part in a graph alone: of a dense stream there are many."""
    return replace(edge, registration=replace(edge.registration, step_psr=(), alternatives=(), evidence=()))


def _runs(parts: Mapping[int, int], between: Sequence[Between], surveys: np.ndarray) -> np.ndarray:
    """(N,) numbers that are equal for scans that follow one another in one part and survey; -1 for those without."""
    part = np.full(len(surveys), -1)
    part[list(parts)] = list(parts.values())
    for each in between:
        if each.T_keys is not None:
            part[each.scan] = parts[each.step.i]
    changes = np.append(False, (np.diff(part) != 0) | (np.diff(surveys) != 0))
    return np.where(part < 0, -1, np.cumsum(changes))


def _control(
    decision: Decision, keys: Sequence[int], measurements: Measurements
) -> tuple[tuple[ControlPoint, ...], tuple[WrongControl, ...]]:
    """The control points of all scans without those that are wrong by the key scans, and these, as they were given."""
    number = {k: n for n, k in enumerate(keys)}
    of_keys = [point for point in measurements.control if point.scan in number]
    # a decision about key scans has the same points with their own numbers
    same = {(each.point.name, keys[each.point.scan]): each.sigmas for each in decision.wrong_control}
    wrong = [point for point in of_keys if (point.name, point.scan) in same]
    kept = [point for point in measurements.control if point.holds and not any(point is each for each in wrong)]
    return tuple(kept), tuple(WrongControl(point, same[point.name, point.scan]) for point in wrong)


def _between(
    keys: Sequence[int],
    decision: Decision,
    measurements: Measurements,
    floor: np.ndarray,
    odd: Collection[int],
) -> list[Between]:
    """For every scan that is no key scan, how it may lie to the key scans beside it."""
    surveys, odometry = measurements.surveys, measurements.odometry and measurements.odometry.scaled(decision.drifts)
    times = scan_times(measurements.stamps, surveys)
    T_poses = decision.solution.trajectory.T_world_sensor
    parts = {pose: part for part, members in enumerate(decision.solution.graph.components) for pose in members}
    registered = {pair.scans: pair.registration for pair in decision.pairs if pair.registration is not None}
    runs = np.array([[parts[a], surveys[k]] for a, k in enumerate(keys)])
    run = np.cumsum(np.concatenate([[0], np.any(np.diff(runs, axis=0) != 0, axis=1)]))
    unsteady = Unsteadiness.of(T_poses, times[list(keys)], run)
    known, between = set(keys), list[Between]()
    for k in range(len(times)):
        if k in known or k in odd:
            continue
        a = bisect_right(keys, k) - 1
        i, b = keys[a], a + 1
        if odometry is not None and odometry.tells(i, k):
            expected = odometry.expected(i, k, floor)
            T_i_k, covariance = expected.T_target_source, expected.covariance
        else:
            before, behind = float(times[k] - times[i]), float(times[keys[b]] - times[k])
            way = _way(T_poses, a, b, parts, registered)
            T_i_k = RigidTransform.from_exp_coords(before / (before + behind) * way)
            covariance = np.diag(floor**2 + unsteady.variance(before, behind))
        step = Registration(T_i_k, covariance, np.nan, np.nan, True, 0.0, "between two key scans")
        T_keys = T_poses[a].inv() * T_poses[b] if parts[a] == parts[b] else None
        between.append(Between(k, Edge(i, k, step, "odometry"), keys[b], T_keys))
    return between


def _way(
    T_keys: RigidTransform,
    a: int,
    b: int,
    parts: Mapping[int, int],
    registered: Mapping[tuple[int, int], Registration],
) -> np.ndarray:
    """(6,) the motion from one key scan to the next, as its logarithm: of the map, or as registered where that is not
    in the map."""
    if parts[a] == parts[b] or (a, b) not in registered:
        return np.asarray((T_keys[a].inv() * T_keys[b]).as_exp_coords())
    return np.asarray(registered[a, b].T_target_source.as_exp_coords())


_ASSUMED_SHARE = 0.1  # of its motion, by which a vehicle is assumed to be off halfway to the next key scan
_ASSUMED_KEYS = 4.0  # key scans that outweigh this assumption


@dataclass(frozen=True, slots=True)
class Unsteadiness:
    """Variances of a tangent, rotation first."""

    shaken: np.ndarray  # (6,) from scan to scan, of every scan by itself [rad^2, m^2]
    # (6,) of half the change of speed, per unit of time^2. By it turns stray from a steady motion, the more the longer
    # it takes.
    curved: np.ndarray

    @classmethod
    def of(cls, T: RigidTransform, times: np.ndarray, run: np.ndarray) -> "Unsteadiness":
        """From n key scans, each compared with steady motions past it, between the two next to it and the two beyond.

        A turn strays from the wider motion by more, as the times tell. What differs otherwise was shaken.

        Args:
            times: (n,) ascending within a run.
            run: (n,) equal for those that are one run of one map, ascending.
        """
        k = np.arange(2, len(times) - 2)
        k = k[run[k - 2] == run[k + 2]]
        assumed = _assumed(T, times, run)
        if not len(k):
            return cls(np.zeros(6), assumed)
        near, near_room, near_noise = _deviations(T, times, k, 1)
        far, far_room, far_noise = _deviations(T, times, k, 2)
        a, b = far_room / (far_room - near_room), near_room / (far_room - near_room)
        straight = a[:, None] * near - b[:, None] * far
        shaken = (straight**2 / (1 + a**2 * near_noise + b**2 * far_noise)[:, None]).mean(axis=0)
        strayed = (near**2).mean(axis=0) - (1 + near_noise).mean() * shaken
        curved = np.maximum(strayed, 0.0) / (near_room**2).mean()
        known = len(k) / (len(k) + _ASSUMED_KEYS)
        return cls(known * shaken, known * curved + (1 - known) * assumed)

    def variance(self, before: float, behind: float) -> np.ndarray:
        """(6,) of a scan about the steady motion from a key scan so much time before it to one so much behind it."""
        share = before / (before + behind)
        return (1 + share**2 + (1 - share) ** 2) * self.shaken + (before * behind) ** 2 * self.curved


def _assumed(T: RigidTransform, times: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(6,) what is curved, before anything is known."""
    inside = np.flatnonzero(np.diff(run) == 0)
    if not len(inside):
        return np.zeros(6)
    steps: np.ndarray = (T[inside].inv() * T[inside + 1]).as_exp_coords()
    lengths = np.median(np.linalg.norm(steps.reshape(-1, 2, 3), axis=2), axis=0)
    halfway = float(np.median(np.diff(times)[inside])) ** 2 / 4
    return np.repeat((_ASSUMED_SHARE * lengths / halfway) ** 2, 3)


def _deviations(
    T: RigidTransform, times: np.ndarray, k: np.ndarray, strides: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, 6) what key scans k are off a steady motion from those so many strides before to those behind.

    And (m,) the product of the times to both, by which a change of speed shows, and (m,) the variance of the steady
    motion there, where every key scan has a variance of 1.
    """
    i, j = k - strides, k + strides
    before, behind = times[k] - times[i], times[j] - times[k]
    share = before / (before + behind)
    way: np.ndarray = (T[i].inv() * T[j]).as_exp_coords()
    steady = T[i] * RigidTransform.from_exp_coords(share[:, None] * way)
    off: np.ndarray = (steady.inv() * T[k]).as_exp_coords()
    return off, before * behind, share**2 + (1 - share) ** 2
