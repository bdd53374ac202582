"""Poses of the scans between key scans: by registration to these, or by continuous trajectories through these."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from operator import mul

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.decision import Decision
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.wrong_control import WrongControl, without_wrong_control
from sonarmap.slam.decide.wrong_measurements import JudgedFixes, judge_fixes
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.place import place_by_control, place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.slam.motion.motion import scan_times
from sonarmap.slam.stream.refine import Between, refine
from sonarmap.spectral.result import Registration


def with_between(
    decision: Decision,
    keys: Sequence[int],
    measurements: Measurements,
    floor: np.ndarray,
    bound: float,
    runner: PairRunner,
) -> Decision:
    """Extend a decision about key scans to all scans.

    A scan between two key scans is registered to one or both of them. If no registration is usable, its edge leads from
    the first key scan to where dead reckoning, or else the motion of the key scans, expects it. Edges and the priors of
    all scans enter the graph.

    Args:
        decision: about the key scans, numbered 0, 1, ...; `keys` are their indices among all scans, ascending.
        floor: (6,) standard deviations added in quadrature to those of a step [rad, m].
        bound: largest distance of two poses that agree [sigmas].
    """
    count, graph = len(measurements.scans), decision.solution.graph
    between = _between(keys, decision, measurements, floor)
    refined = refine(runner, between, floor, bound)
    edges = [refined.get(each.scan, each.step) for each in between]
    interpolated = tuple(each.scan for each in between if each.scan not in refined)

    def expanded(T_keys: RigidTransform) -> Trajectory:
        poses = {k: T_keys[n] for n, k in enumerate(keys)}
        for each in between:
            poses[each.scan] = poses[each.step.i] * each.step.registration.T_target_source
        return Trajectory(measurements.stamps, RigidTransform.concatenate([poses[k] for k in range(count)]))

    kept = [replace(edge, i=keys[edge.i], j=keys[edge.j]) for edge in graph.edges]
    whole = PoseGraph(expanded(graph.trajectory.T_world_sensor), (*kept, *edges))
    solution, judged, wrong_control = _solved(whole, measurements)
    solution = replace(
        solution,
        chi_squared_before=decision.solution.chi_squared_before,
        degrees_of_freedom=decision.solution.degrees_of_freedom,
    )
    pairs = tuple(pair.renumbered(dict(enumerate(keys))) for pair in decision.pairs)
    chained = expanded(decision.chained.T_world_sensor)
    return Decision(
        chained,
        solution,
        pairs,
        judged,
        wrong_control,
        decision.drifts,
        other_places=tuple(place.renumbered(keys) for place in decision.other_places),
        interpolated=interpolated,
    )


def _solved(graph: PoseGraph, measurements: Measurements) -> tuple[Solution, JudgedFixes, tuple[WrongControl, ...]]:
    """The optimum of the graph of all scans with its accepted fixes and control points; and the wrong ones.

    Those of scans between key scans may be all that places the map in the world."""
    priors, control = measurements.priors, tuple(point for point in measurements.control if point.holds)
    placed = place_in_world(graph.trajectory, graph.components, priors)
    placed = place_by_control(placed, graph.components, control, priors)
    graph = replace(graph, trajectory=placed)
    judged = judge_fixes(graph, priors)
    graph = replace(graph, priors=tuple(sorted(judged.priors.items())), control=control)
    control, wrong_control = without_wrong_control(graph)
    return replace(graph, control=control).optimize(), judged, wrong_control


def _between(
    keys: Sequence[int],
    decision: Decision,
    measurements: Measurements,
    floor: np.ndarray,
) -> list[Between]:
    """The scans between key scans, each with its step from the key scan before it."""
    odometry = measurements.odometry and measurements.odometry.scaled(decision.drifts)
    T_keys, components = decision.solution.trajectory.T_world_sensor, _components(decision)
    by_motion, between = _by_motion(keys, decision, measurements), list[Between]()
    for a, (i, after) in enumerate(pairwise(keys)):
        T_i_after = T_keys[a].inv() * T_keys[a + 1] if components[a] == components[a + 1] else None
        for k in range(i + 1, after):
            if odometry is not None and odometry.tells(i, k):
                expected = odometry.expected(i, k, floor)
                T_i_k, covariance = expected.T_target_source, expected.covariance
            else:
                T_i_k, covariance = by_motion[k][0], by_motion[k][1] + np.diag(floor**2)
            step = Registration(T_i_k, covariance, np.nan, np.nan, True, 0.0, "between two key scans")
            between.append(Between(k, Edge(i, k, step, "odometry"), after, T_i_after))
    return between


def _components(decision: Decision) -> dict[int, int]:
    """The number of each scan's component."""
    return {k: n for n, members in enumerate(decision.solution.graph.components) for k in members}


def _by_motion(
    keys: Sequence[int], decision: Decision, measurements: Measurements
) -> dict[int, tuple[RigidTransform, np.ndarray]]:
    """Every scan between key scans by continuous trajectories through these: its pose in the frame of the key scan
    before it, and the (6, 6) covariance of this, rotation first [rad, m], body tangent.

    A trajectory ends where the next scan is a key scan too: no scan is between, and the sensor may have jumped there.
    """
    times, at_keys = scan_times(measurements.stamps, measurements.surveys), np.asarray(keys)
    steps, motions, scans = _steps(decision), list[ContinuousTrajectory](), list[np.ndarray]()
    for run in np.split(np.arange(len(keys)), np.flatnonzero(np.diff(at_keys) == 1) + 1):
        inside = np.setdiff1d(np.arange(keys[run[0]], keys[run[-1]]), at_keys[run])
        if not len(inside):
            continue
        T_knots = list(accumulate(steps[run[0] : run[-1]], mul, initial=RigidTransform.identity()))
        knots = Trajectory(times[at_keys[run]], RigidTransform.concatenate(T_knots))
        motions.append(ContinuousTrajectory.through(knots, np.zeros((len(run), 6, 6))))
        scans.append(inside)
    if not motions:
        return {}
    freedom = [max(len(motion.knots) - 2, 1e-9) for motion in motions]  # two key scans show a steady motion
    power = np.average([motion.power for motion in motions], axis=0, weights=freedom)
    shaken = np.average([motion.shaken for motion in motions], axis=0, weights=freedom)
    expected: dict[int, tuple[RigidTransform, np.ndarray]] = {}
    for motion, inside in zip(motions, scans, strict=True):
        poses, covariances = replace(motion, power=power).at(times[inside])
        before = np.searchsorted(motion.knots.stamps, times[inside], side="right") - 1
        T_before_scan = motion.knots.T_world_sensor[before].inv() * poses.T_world_sensor
        covariances = covariances + 2 * np.diag(shaken)  # of the scan and of the key scan
        expected |= {k: (T_before_scan[n], covariances[n]) for n, k in enumerate(inside.tolist())}
    return expected


def _steps(decision: Decision) -> list[RigidTransform]:
    """The motion from each key scan to the next: by the map if they share a component, else by their registration if
    there is one."""
    T_keys, components = decision.solution.trajectory.T_world_sensor, _components(decision)
    registered = {pair.scans: pair.registration for pair in decision.pairs if pair.registration is not None}
    return [
        T_keys[a].inv() * T_keys[a + 1]
        if components[a] == components[a + 1] or (a, a + 1) not in registered
        else registered[a, a + 1].T_target_source
        for a in range(len(T_keys) - 1)
    ]
