"""Poses of the scans between key scans: by registration to these, or interpolated, with an uncertainty learned from how
the key scans deviate from a steady motion."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
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
from sonarmap.slam.stream.refine import Between, Refined, refine, without_jumps
from sonarmap.spectral.result import Registration


def with_between(
    decision: Decision,
    keys: Sequence[int],
    measurements: Measurements,
    floor: np.ndarray,
    runner: PairRunner,
) -> Decision:
    """Extend a decision about key scans to all scans.

    A scan between two key scans is registered to one or both of them. If no registration is usable, its edge follows
    dead reckoning from the first key scan, or else a steady motion from one key scan to the other. Edges and the priors
    of all scans enter the graph.

    Args:
        decision: about the key scans, numbered 0, 1, ...; `keys` are their indices among all scans, ascending.
        floor: (6,) standard deviations added in quadrature to those of a step [rad, m].
    """
    count, graph = len(measurements.scans), decision.solution.graph
    between = _between(keys, decision, measurements, floor)
    refined = _refined(between, keys, decision, measurements, floor, runner)
    edges = [_slim(edge) for of_scan in refined.edges.values() for edge in of_scan]
    interpolated = tuple(refined.left)
    del refined  # frees the memory of all registered pairs
    at_keys = {k: number for number, k in enumerate(keys)}

    def expanded(T_keys: RigidTransform) -> Trajectory:
        poses = {k: T_keys[n] for k, n in at_keys.items()}
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
    return Decision(chained, solution, pairs, judged, wrong_control, decision.drifts, interpolated)


def _solved(
    whole: PoseGraph, keys: Sequence[int], decision: Decision, measurements: Measurements
) -> tuple[Solution, JudgedFixes, tuple[WrongControl, ...]]:
    """The optimum of the graph of all scans with its accepted fixes and control points; and the wrong ones."""
    if set(measurements.priors) - set(keys):
        # fixes of scans between key scans may be all that places the map in the world
        whole = replace(whole, trajectory=place_in_world(whole.trajectory, whole.components, measurements.priors))
        judged = judge_fixes(whole, measurements.priors)
    else:
        judged = replace(decision.fixes, priors={keys[k]: prior for k, prior in decision.solution.graph.priors})
    measured = tuple(sorted(judged.priors.items()))
    control, wrong_control = _control(decision, keys, measurements)
    if control:
        # points of scans between key scans may be all that places the map in the world
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
    """Edges from the scans between to key scans, without jumps."""
    graph = decision.solution.graph
    components = {keys[k]: n for n, members in enumerate(graph.components) for k in members}
    T_keys = {k: decision.solution.trajectory.T_world_sensor[n] for n, k in enumerate(keys)}
    times = scan_times(measurements.stamps, measurements.surveys)
    runs = _runs(components, between, measurements.surveys)
    return without_jumps(runner, between, refine(runner, between, floor), T_keys, times, runs, floor)


def _slim(edge: Edge) -> Edge:
    """The edge with only what the graph needs: a dense stream has many edges."""
    return replace(edge, registration=replace(edge.registration, step_psr=(), alternatives=(), evidence=()))


def _runs(components: Mapping[int, int], between: Sequence[Between], surveys: np.ndarray) -> np.ndarray:
    """(N,) numbers, equal for consecutive scans of one component and survey; -1 for scans without a component."""
    component = np.full(len(surveys), -1)
    component[list(components)] = list(components.values())
    for each in between:
        if each.T_keys is not None:
            component[each.scan] = components[each.step.i]
    changes = np.append(False, (np.diff(component) != 0) | (np.diff(surveys) != 0))
    return np.where(component < 0, -1, np.cumsum(changes))


def _control(
    decision: Decision, keys: Sequence[int], measurements: Measurements
) -> tuple[tuple[ControlPoint, ...], tuple[WrongControl, ...]]:
    """The control points of all scans but those that the decision about key scans found wrong; and the wrong ones."""
    number = {k: n for n, k in enumerate(keys)}
    of_keys = [point for point in measurements.control if point.scan in number]
    # in the decision, scans have the numbers of key scans
    sigmas = {(w.point.name, keys[w.point.scan]): w.sigmas for w in decision.wrong_control}
    wrong = [point for point in of_keys if (point.name, point.scan) in sigmas]
    kept = [point for point in measurements.control if point.holds and not any(point is w for w in wrong)]
    return tuple(kept), tuple(WrongControl(point, sigmas[point.name, point.scan]) for point in wrong)


def _between(
    keys: Sequence[int],
    decision: Decision,
    measurements: Measurements,
    floor: np.ndarray,
) -> list[Between]:
    """The scans between key scans, each with its step from the key scan before it."""
    surveys, odometry = measurements.surveys, measurements.odometry and measurements.odometry.scaled(decision.drifts)
    times = scan_times(measurements.stamps, surveys)
    T_poses = decision.solution.trajectory.T_world_sensor
    component = {key: n for n, members in enumerate(decision.solution.graph.components) for key in members}
    registered = {pair.scans: pair.registration for pair in decision.pairs if pair.registration is not None}
    runs = np.array([[component[a], surveys[k]] for a, k in enumerate(keys)])
    run = np.cumsum(np.concatenate([[0], np.any(np.diff(runs, axis=0) != 0, axis=1)]))
    unsteady = Unsteadiness.of(T_poses, times[list(keys)], run)
    is_key, between = set(keys), list[Between]()
    for k in range(len(times)):
        if k in is_key:
            continue
        a = bisect_right(keys, k) - 1
        i, b = keys[a], a + 1
        if odometry is not None and odometry.tells(i, k):
            expected = odometry.expected(i, k, floor)
            T_i_k, covariance = expected.T_target_source, expected.covariance
        else:
            before, after = float(times[k] - times[i]), float(times[keys[b]] - times[k])
            motion = _motion(T_poses, a, b, component, registered)
            T_i_k = RigidTransform.from_exp_coords(before / (before + after) * motion)
            covariance = np.diag(floor**2 + unsteady.variance(before, after))
        step = Registration(T_i_k, covariance, np.nan, np.nan, True, 0.0, "between two key scans")
        T_keys = T_poses[a].inv() * T_poses[b] if component[a] == component[b] else None
        between.append(Between(k, Edge(i, k, step, "odometry"), keys[b], T_keys))
    return between


def _motion(
    T_keys: RigidTransform,
    a: int,
    b: int,
    component: Mapping[int, int],
    registered: Mapping[tuple[int, int], Registration],
) -> np.ndarray:
    """(6,) logarithm of the motion from one key scan to the next: by the map if they share a component, else by their
    registration if there is one."""
    if component[a] == component[b] or (a, b) not in registered:
        return np.asarray((T_keys[a].inv() * T_keys[b]).as_exp_coords())
    return np.asarray(registered[a, b].T_target_source.as_exp_coords())


_PRIOR_SHARE = 0.1  # prior deviation from a steady motion, halfway between key scans [motions between these]
_PRIOR_KEYS = 4.0  # weight of this prior [key scans]


@dataclass(frozen=True, slots=True)
class Unsteadiness:
    """Variances of the deviation from a steady motion: tangent, rotation first."""

    shaken: np.ndarray  # (6,) of every scan, independent of the others [rad^2, m^2]
    curved: np.ndarray  # (6,) of half the acceleration [rad^2, m^2 per time^4]; its effect grows with time

    @classmethod
    def of(cls, T: RigidTransform, times: np.ndarray, run: np.ndarray) -> "Unsteadiness":
        """Learn from n key scans, each compared with steady motions between its neighbors and between the next ones.

        An acceleration deviates more from the wider motion, by a factor that the times give; the rest was shaken.

        Args:
            times: (n,) ascending within a run.
            run: (n,) ascending, equal for consecutive key scans of one component and survey.
        """
        k = np.arange(2, len(times) - 2)
        k = k[run[k - 2] == run[k + 2]]
        prior = _prior_curved(T, times, run)
        if not len(k):
            return cls(np.zeros(6), prior)
        near, near_room, near_noise = _deviations(T, times, k, 1)
        far, far_room, far_noise = _deviations(T, times, k, 2)
        a, b = far_room / (far_room - near_room), near_room / (far_room - near_room)
        straight = a[:, None] * near - b[:, None] * far
        shaken = (straight**2 / (1 + a**2 * near_noise + b**2 * far_noise)[:, None]).mean(axis=0)
        excess = (near**2).mean(axis=0) - (1 + near_noise).mean() * shaken
        curved = np.maximum(excess, 0.0) / (near_room**2).mean()
        weight = len(k) / (len(k) + _PRIOR_KEYS)
        return cls(weight * shaken, weight * curved + (1 - weight) * prior)

    def variance(self, before: float, after: float) -> np.ndarray:
        """(6,) of a scan about the steady motion between key scans at times `before` and `after` it."""
        share = before / (before + after)
        return (1 + share**2 + (1 - share) ** 2) * self.shaken + (before * after) ** 2 * self.curved


def _prior_curved(T: RigidTransform, times: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(6,) prior of `Unsteadiness.curved`."""
    inside = np.flatnonzero(np.diff(run) == 0)
    if not len(inside):
        return np.zeros(6)
    steps: np.ndarray = (T[inside].inv() * T[inside + 1]).as_exp_coords()
    lengths = np.median(np.linalg.norm(steps.reshape(-1, 2, 3), axis=2), axis=0)
    halfway = float(np.median(np.diff(times)[inside])) ** 2 / 4
    return np.repeat((_PRIOR_SHARE * lengths / halfway) ** 2, 3)


def _deviations(
    T: RigidTransform, times: np.ndarray, k: np.ndarray, strides: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, 6) deviations of key scans k from the steady motions between the key scans `strides` before and after them.

    Also (m,) the products of the times to both, which scale the effect of an acceleration, and (m,) the variances of
    the steady motions there if every key scan has a variance of 1.
    """
    i, j = k - strides, k + strides
    before, after = times[k] - times[i], times[j] - times[k]
    share = before / (before + after)
    motion: np.ndarray = (T[i].inv() * T[j]).as_exp_coords()
    steady = T[i] * RigidTransform.from_exp_coords(share[:, None] * motion)
    deviations: np.ndarray = (steady.inv() * T[k]).as_exp_coords()
    return deviations, before * after, share**2 + (1 - share) ** 2
