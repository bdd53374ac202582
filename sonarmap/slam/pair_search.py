"""The search for pairs to register, stage by stage: consecutive scans, bridges over gaps, loops, and retries."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from sonarmap.slam.candidates.candidates import find_candidates, find_lookalikes
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import Decision, decide
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.decide.other_place import other_places
from sonarmap.slam.decide.verdict import CONTRADICTED, with_contradictions
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.map.cell import outline
from sonarmap.slam.motion.limits import MotionLimits
from sonarmap.slam.motion.measured_motion import AnyMotion, MeasuredMotion
from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.motion.reconsider import (
    expected_by,
    is_doubtful,
    with_both,
    with_motion,
    without_unreachable,
)
from sonarmap.slam.pair import Candidate, RegisteredPair, require_any_registered
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registrar

_WORTH_A_ROUND = 0.01  # least number of uncertain candidates per scan that justifies another round of inference


def register_steps(runner: PairRunner, runs: np.ndarray, known: Sequence[RegisteredPair]) -> list[RegisteredPair]:
    """Consecutive scans registered by the scans alone; `runs` are the (N,) scans' runs, `known` pairs are reused."""
    by_scans = {pair.scans: pair for pair in known}
    steps = [Candidate(k, k + 1, "sequential") for k in range(len(runs) - 1) if runs[k] == runs[k + 1]]
    by_scans |= {pair.scans: pair for pair in runner.register([step for step in steps if step.scans not in by_scans])}
    return [by_scans[step.scans] for step in steps]


@dataclass(frozen=True, slots=True)
class _LeftOut:
    """Pairs (i, j) that are no candidates: those that were tried, and those of the first `settled` scans."""

    tried: frozenset[tuple[int, int]]
    settled: int

    def __contains__(self, scans: tuple[int, int]) -> bool:
        return max(scans) < self.settled or scans in self.tried


class PairSearch:
    """Registers the pairs of one survey, or of several of one place.

    Every pair is registered by the scans alone first. A pair that is doubtful, or that the vehicle's motion
    contradicts, is registered again about the pose that the motion or the estimate expects: among places of similar
    shape this finds the one where the vehicle can be.

    Args:
        measurements: with the scans; if there is dead reckoning, it gives the expected poses.
        registrar: the method; retries need its `register_expected`.
        settled: number of first scans whose relative poses are known; no loops are sought among them.
        looked: retries of earlier searches, by their scans, which are not repeated; this search adds its own. None:
            every retry is about the pose that is expected now.
    """

    def __init__(
        self,
        runner: PairRunner,
        measurements: Measurements,
        registrar: Registrar,
        voxel: float,
        loops: LoopSettings,
        limits: MotionLimits,
        settled: int = 0,
        looked: dict[tuple[int, int], RegisteredPair] | None = None,
    ) -> None:
        self._looked = looked
        self._settled = settled
        self._runner, self._registrar = runner, registrar
        self.measurements = measurements  # after `steps`, with the odometry's drift estimated from these
        self._voxel, self._settings, self._limits = voxel, loops, limits
        self._floor = loops.floor(voxel)
        self._motion: AnyMotion | None = None
        self._placed: Solution | None = None  # by steps and fixes; None without fixes
        self._outlines: list[np.ndarray] = []

    def decided(self, known: Sequence[RegisteredPair], widest: int) -> Decision:
        """The decision about all pairs; `known` steps are already registered, bridges are at most `widest` scans apart.

        The search ignores ties and control points, so that it registers the same pairs with and without them.
        """
        loops, pairs = self._settings, self.steps(known)
        pairs += self.bridges(pairs, widest)
        require_any_registered(pairs)
        untied = self.measurements.by_instruments
        decision = self._decide(pairs, untied)
        for number in range(loops.most_rounds if loops.rounds else 0):
            more = self.loops(decision, pairs, unsure=number >= loops.rounds)
            if not more:
                break
            pairs += more
            decision = self._decide(pairs, untied)
        if self.measurements.ties or self.measurements.control:
            tied = self._decide(self.tied(pairs), self.measurements)
            decision = replace(tied, pairs=tuple(with_contradictions(tied.pairs, decision.solution)))
        if any(pair.contradicted > CONTRADICTED for pair in decision.pairs):
            return decision  # a wrong tie displaces scans, and is reported itself
        places = other_places(decision.solution.graph, decision.pairs, self._floor, loops.bound)
        return replace(decision, other_places=places)

    def _decide(self, pairs: Sequence[RegisteredPair], measurements: Measurements) -> Decision:
        decision = decide(pairs, measurements, self._voxel, self._settings)
        self._runner.end_stage("poses optimized")
        return decision

    def steps(self, known: Sequence[RegisteredPair] = ()) -> list[RegisteredPair]:
        """Consecutive scans of each survey, from which the motion is learned; `known` pairs are reused."""
        survey = self.measurements.surveys
        pairs = register_steps(self._runner, self.measurements.runs, known)
        if (odometry := self.measurements.odometry) is not None:
            odometry = odometry.as_registered(pairs)
            self.measurements = replace(self.measurements, odometry=odometry)
        motion = Motion.learn(pairs, self.measurements.stamps, survey, self._floor, self._limits)
        self._motion = motion if odometry is None else MeasuredMotion(odometry, motion, self._floor)
        if any(prior.knows_position for prior in self.measurements.priors.values()):
            self._placed = decide(pairs, self.measurements.by_instruments, self._voxel, self._settings).solution
        pairs = self._retried(pairs)
        if self._motion is not None:
            self._motion = self._motion.following(pairs)
        return self._with_motion(pairs)

    def bridges(self, steps: Sequence[RegisteredPair], widest: int) -> list[RegisteredPair]:
        """Pairs across gaps, the closest scans first and at most `widest` apart; none farther once a gap is bridged."""
        surveys = self.measurements.surveys
        joined = DisjointSet(range(len(surveys)))
        for pair in steps:
            if pair.accepted:
                joined.merge(*pair.scans)
        gaps = [pair.i for pair in steps if not pair.accepted]
        bridges: list[RegisteredPair] = []
        for span in range(2, widest + 1):
            across = dict.fromkeys(scans for gap in gaps for scans in _across(gap, span, surveys))
            candidates = [Candidate(*scans, "bridge") for scans in across if not joined.connected(*scans)]
            for pair in self._with_motion(self._retried(self._runner.register(candidates))):
                bridges.append(pair)
                if pair.accepted:
                    joined.merge(*pair.scans)
        return bridges

    def loops(self, decision: Decision, tried: Sequence[RegisteredPair], unsure: bool = False) -> list[RegisteredPair]:
        """The next loops after a decision about the pairs `tried`; none if no candidates are left.

        `unsure`: only of scans whose relative pose is no more certain in the estimate than in a registration.
        """
        left_out = _LeftOut(frozenset(pair.scans for pair in tried), self._settled)
        candidates = self._candidates(decision, left_out, unsure)
        self._runner.end_stage("candidates sought")
        if not candidates or (unsure and len(candidates) < _WORTH_A_ROUND * len(self.measurements.scans)):
            return []
        pairs = self._runner.register(candidates)
        if self._motion is not None:
            survey = self.measurements.surveys.tolist()
            pairs = [without_unreachable(p, self._motion) if survey[p.i] == survey[p.j] else p for p in pairs]
        if not hasattr(self._registrar, "register_expected"):
            return pairs
        return self._about_estimate(pairs, decision.solution)

    def tied(self, tried: Sequence[RegisteredPair]) -> list[RegisteredPair]:
        """The pairs and those that a person added, with a person's transforms in place of registrations.

        Only pairs that a person added are registered: ties change the inference, not the search.
        """
        known = {pair.scans for pair in tried}
        ties = self.measurements.ties
        new = [tie for tie in ties.values() if tie.verdict == "add" and tie.scans not in known]
        candidates = [Candidate(*tie.scans, "loop") for tie in new if tie.given is None]
        given = [RegisteredPair(*tie.scans, "loop") for tie in new if tie.given is not None]
        added = {pair.scans: pair for pair in (*self._runner.register(candidates), *given)}
        pairs = [*tried, *(added[tie.scans] for tie in new)]
        return [
            replace(pair, registration=tie.given, failure="") if (tie := ties.get(pair.scans)) and tie.given else pair
            for pair in pairs
        ]

    def _retried(self, pairs: Sequence[RegisteredPair]) -> list[RegisteredPair]:
        """The pairs, doubtful ones registered again about the pose that fixes, or else the motion, expect."""
        motion = self._motion
        if not hasattr(self._registrar, "register_expected"):
            return list(pairs)
        pairs = self._about_estimate(pairs, self._placed) if self._placed is not None else list(pairs)
        if motion is None:
            return pairs
        doubtful = [pair for pair in pairs if pair.expected is None and is_doubtful(pair, motion)]
        return self._retried_at(pairs, doubtful, [motion.expected(*pair.scans) for pair in doubtful], motion)

    def _about_estimate(self, pairs: Sequence[RegisteredPair], solution: Solution) -> list[RegisteredPair]:
        """The pairs, those not accepted, or consecutive but not in the graph, registered again about the estimate."""
        component = {k: number for number, members in enumerate(solution.graph.components) for k in members}
        kept = {(edge.i, edge.j) for edge in solution.graph.edges}
        trusted = [pair.accepted and (pair.role != "sequential" or pair.scans in kept) for pair in pairs]
        doubtful = [
            pair
            for pair, is_trusted in zip(pairs, trusted, strict=True)
            if not is_trusted and pair.registration and component[pair.i] == component[pair.j]
        ]
        return self._retried_at(pairs, doubtful, expected_by(solution, doubtful, self._floor))

    def _retried_at(
        self,
        pairs: Sequence[RegisteredPair],
        doubtful: Sequence[RegisteredPair],
        expected: Sequence[ExpectedPose],
        motion: AnyMotion | None = None,
    ) -> list[RegisteredPair]:
        """The pairs, doubtful ones combined with their registrations about expected poses (`with_both`)."""
        retries = [replace(pair, expected=pose) for pair, pose in zip(doubtful, expected, strict=True)]
        done = {} if self._looked is None else self._looked
        done |= {pair.scans: pair for pair in self._runner.register([p for p in retries if p.scans not in done])}
        retried = {pair.scans for pair in retries}
        return [with_both(pair, done[pair.scans], motion) if pair.scans in retried else pair for pair in pairs]

    def _with_motion(self, pairs: Sequence[RegisteredPair]) -> list[RegisteredPair]:
        """The pairs combined with the learned motion, but not with dead reckoning, which is in the graph itself."""
        motion = self._motion
        if motion is None:
            return list(pairs)
        free = [pair for pair in pairs if not motion.is_measured(*pair.scans)]
        held = {pair.scans: pair for pair in with_motion(free, motion)}
        return [held.get(pair.scans, pair) for pair in pairs]

    def _candidates(self, decision: Decision, left_out: _LeftOut, unsure: bool) -> list[Candidate]:
        """Pairs to try next, in the order of the scans: neighbors in that order share prepared scans."""
        if not self._outlines:
            self._outlines = [
                outline(scan, self._settings.cell_voxels * self._voxel) for scan in self.measurements.scans
            ]
        solution = decision.solution
        candidates = find_candidates(self._outlines, solution, self._voxel, self._settings, left_out, unsure)
        components = solution.graph.components
        # between components there is no estimate of the overlap, but signatures can be compared
        if len(components) > 1 and hasattr(self._registrar, "signature"):
            candidates += find_lookalikes(self._runner.signatures(), components, self._settings, left_out)
        return sorted(candidates, key=lambda candidate: candidate.scans)


def _across(gap: int, span: int, survey: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of one survey, `span` scans apart, with the gap (gap, gap + 1) between them."""
    firsts = [i for i in range(gap, gap - span, -1) if i >= 0 and i + span < len(survey)]
    return [(i, i + span) for i in firsts if survey[i] == survey[i + span]]
