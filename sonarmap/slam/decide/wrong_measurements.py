"""Fixes that all other measurements contradict: an acoustic outlier, a compass that jumped.

They are found by reweighted least squares with Student's t: a fix that is far off gets a lower weight in each round,
until the other measurements determine the pose. A fix of a pose without other measurements is never wrong.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.decide.systematic import KINDS_OF_ERROR, SCALE, SharedError, Systematic
from sonarmap.slam.graph.known_pose import MeasuredPoses
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.chi_squared import chi_squared, chi_squared_beyond
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior

# Kinds of measurements, and their numbers among a prior's sigmas.
KINDS = {"attitude": slice(0, 2), "heading": slice(2, 3), "position": slice(3, 5), "depth": slice(5, 6)}
_SIZES = np.array([numbers.stop - numbers.start for numbers in KINDS.values()])
_MEDIANS = chi_squared(0.5, _SIZES)  # of chi-squared, by kind
TAILS = 2.0  # degrees of freedom of Student's t
_MAX_ROUNDS = 12  # of reweighting
_MIN_CHANGE = 1e-2  # of a weight in a round; a smaller one is the last
_FAR = 1e-5  # probability that a right measurement is as far off as a wrong one
_MAX_WRONG = 0.4  # share of the fixes of a kind; if more seem wrong, the registrations are
_MIN_FIXES = 8  # of a kind, to compare actual with stated errors
_UNDERESTIMATED = 2.0  # ratio of actual to stated errors from which sigmas are scaled
NOTHING = 10.0  # ratio from which a kind is ignored: axes are exchanged, or times are off
_MIN_FALL = 5.0  # of chi-squared by the first step of a kind of systematic error that is tried
_DECISIVE = 15.0  # by which a systematic error lowers the cost, and another error with other poses is worse
_OTHER_POSES = 3.0  # mean distance of positions from which two errors lead to other poses [sigmas]
_EXPLAINED = [list(KINDS).index(kind) for kind in ("heading", "position")]  # kinds that a systematic error changes
_MAX_STEPS = 8  # of Gauss-Newton
_MIN_STEP = 0.02  # as a share of the error; a smaller one is the last
_MAX_TILT_SIGMA = float(np.deg2rad(3.0))  # with which a systematic error can be estimated [rad]


@dataclass(frozen=True, slots=True)
class WrongFix:
    """A measurement that was left out."""

    scan: int  # its index
    kind: str  # of KINDS
    sigmas: float  # Mahalanobis distance from the estimate by all others
    place: tuple[float, ...] | None = None  # a measured position, east and north [m]


@dataclass(frozen=True, slots=True)
class JudgedFixes:
    """Fixes of instruments, compared with all other measurements."""

    priors: dict[int, PosePrior]  # by pose, without wrong fixes, and with sigmas by their actual errors
    wrong: tuple[WrongFix, ...] = ()
    # by kind, ratio of actual to stated errors; from `NOTHING` on the kind is left out
    understated: Mapping[str, float] = field(default_factory=dict[str, float])
    systematic: Systematic | None = None  # error of all fixes, removed from the priors


def judge_fixes(graph: PoseGraph, priors: Mapping[int, PosePrior]) -> JudgedFixes:
    """The priors without those that the edges and other priors contradict, and with sigmas by their actual errors.

    Args:
        graph: edges between the poses, which are close to their places in the world; its own priors are not used.
        priors: what instruments measured, by pose.
    """
    if not priors:
        return JudgedFixes({})
    fixes = _Fixes.of(priors)
    solution, weights = _solved(graph, fixes)
    found = _explained(graph, _Explanation(Systematic(), fixes, solution, weights, fixes.cost(solution), fits=True))
    fixes, solution, weights, error = found.fixes, found.at, found.weights, found.error
    factors = fixes.understated(solution.trajectory.T_world_sensor)
    fixes = fixes.scaled(factors)
    wrong = _wrong_fixes(solution, fixes, weights)
    if _too_many(wrong, fixes):
        return JudgedFixes(dict(priors))
    understated = {kind: factor for kind, factor in zip(KINDS, factors.tolist(), strict=True) if factor > 1}
    useless = {kind for kind, factor in understated.items() if factor >= NOTHING}
    wrong = tuple(fix for fix in wrong if fix.kind not in useless)
    left_out = {(fix.scan, fix.kind) for fix in wrong}
    cleaned = {
        k: without_kinds(prior, useless | {kind for kind in KINDS if (k, kind) in left_out})
        for k, prior in zip(fixes.poses.tolist(), fixes.priors, strict=True)
    }
    left = {k: prior for k, prior in cleaned.items() if prior is not None}
    return JudgedFixes(left, wrong, understated, error if error.numbers.any() else None)


def agreement(
    priors: Mapping[int, PosePrior], wrong: Sequence[WrongFix], T_world_sensor: RigidTransform
) -> dict[str, tuple[int, int, float]]:
    """By kind: number of used fixes, number of all fixes, and median distance of the used ones from the poses [sigmas].

    Args:
        priors: those that are used, by pose.
        wrong: those that are left out.
        T_world_sensor: the poses.
    """
    if not priors:
        return {}
    fixes = _Fixes.of(priors)
    sigmas = np.sqrt(fixes._squared(T_world_sensor) / _SIZES)
    by_kind: dict[str, tuple[int, int, float]] = {}
    for kind, own, known in zip(KINDS, sigmas.T, fixes.known.T, strict=True):
        if known.any():
            used, left_out = int(known.sum()), sum(fix.kind == kind for fix in wrong)
            by_kind[kind] = used, used + left_out, float(np.median(own[known]))
    return by_kind


@dataclass(frozen=True, slots=True)
class _Explanation:
    """A systematic error, and the optimum with fixes corrected by it."""

    error: Systematic
    fixes: "_Fixes"  # corrected
    at: Solution  # their optimum with the edges
    weights: np.ndarray  # (n, K) of the fixes there
    cost: float  # twice the negative logarithm of the likelihood
    fits: bool  # whether the error is plausible for a vehicle, and fixes and edges fit with it

    @property
    def linearized(self) -> SharedError:
        """The cost of changes of the error."""
        return self.fixes.shared_error(self.at, self.weights, self.error)

    def with_alternative(self, others: Sequence["_Explanation"]) -> "_Explanation":
        """With one of the others as alternative, if it fits about as well and has other poses."""
        close = (other for other in others if other.fits and other.cost < self.cost + _DECISIVE)
        unclear = next((other.error for other in close if self.fixes.apart(self.at, other.at) > _OTHER_POSES), None)
        return replace(self, error=replace(self.error, alternative=unclear))


def _explained(graph: PoseGraph, plain: _Explanation) -> _Explanation:
    """The systematic error of the fixes: one kind, and further kinds if each lowers the cost enough.

    None is estimated if the tilt is unknown, as it would be taken for a lever arm. First steps are those at the `plain`
    optimum, and at one with full weights of edges: otherwise one edge could give way instead of all fixes.
    """
    if not plain.fixes.know_tilt(plain.at):
        return plain
    best = found = plain
    full = replace(graph, priors=plain.at.graph.priors).optimize()
    starts, free = [plain.linearized, plain.fixes.shared_error(full, plain.weights)], ()
    while True:
        tried: list[tuple[_Explanation, tuple[int, ...]]] = []
        for kind in (kind for kind in KINDS_OF_ERROR if kind[0] not in free and plain.fixes.suffice_for(kind)):
            numbers = (*free, *kind)
            fall, step = max((look.step(numbers) for look in starts), key=lambda look: look[0])
            if fall >= _MIN_FALL:
                more = _explanation(graph, plain, best, step, numbers)
                if best.cost - more.cost >= _DECISIVE:
                    tried.append((more, numbers))
        if not tried:
            return found
        tried.sort(key=lambda each: (not each[0].fits, each[0].cost))
        best, free = tried[0]
        starts = [best.linearized]
        if best.fits:
            found = best.with_alternative([each for each, _ in tried[1:]])


def _explanation(
    graph: PoseGraph, plain: _Explanation, before: _Explanation, step: np.ndarray, free: tuple[int, ...]
) -> _Explanation:
    """The error with optimal `free` numbers, by Gauss-Newton from the error `before` and the first `step`."""
    error, fixes, at, weights = before.error, before.fixes, before.at, before.weights
    for _ in range(_MAX_STEPS):
        error = Systematic(*(error.numbers + step).tolist())
        fixes = plain.fixes.corrected(error, at.trajectory)
        at, weights = _solved(graph, fixes)
        _, step = fixes.shared_error(at, weights, error).step(free)
        if np.abs(step).max() < _MIN_STEP * np.abs(error.numbers).max():
            break
    # a lever arm may also explain some wrong fixes or edges, as over a flat bed; a real one makes no edge fit worse
    fits = error.is_likely and _strained(at) <= _strained(plain.at)
    fits = fits and fixes.fit(at.trajectory.T_world_sensor, _EXPLAINED)
    return _Explanation(error, fixes, at, weights, fixes.cost(at) + error.unlikeliness, fits)


def _strained(solution: Solution) -> int:
    """Number of edges that are farther off than 1 of 10,000 right ones."""
    return int((solution.graph.residuals() ** 2 > chi_squared_beyond(_FAR, 6)).sum())


def _solved(graph: PoseGraph, fixes: "_Fixes") -> tuple[Solution, np.ndarray]:
    """The optimum of edges and fixes, and the fixes' weights there."""

    def weighed(graph: PoseGraph, weights: np.ndarray) -> PoseGraph:
        return replace(graph, priors=tuple(zip(fixes.poses.tolist(), fixes.weighed(weights), strict=True)))

    def weights_at(graph: PoseGraph) -> np.ndarray:
        return np.where(fixes.known, fixes.weights_at(graph.trajectory.T_world_sensor), 1.0)

    # far fixes begin with a low weight: with full weight they would pull scans off their edges, which can be wrong too
    start = weights_at(graph)
    start /= np.where(fixes.known, start, 0.0).max(axis=0, initial=1e-12)
    return reweighted(graph, np.minimum(start, 1.0), weighed, weights_at, edges_too=True)


def reweighted(
    graph: PoseGraph,
    weights: np.ndarray,
    weighed: Callable[[PoseGraph, np.ndarray], PoseGraph],
    weights_at: Callable[[PoseGraph], np.ndarray],
    edges_too: bool = False,
) -> tuple[Solution, np.ndarray]:
    """The optimum and the measurements' weights there; `weighed` gives a graph whose measurements have given weights,
    `weights_at` the weights by the distance of a graph's poses from the measurements."""
    solution, of_edges = None, np.ones(len(graph.edges))
    for _ in range(_MAX_ROUNDS):
        solution = weighed(graph.with_scale_factors(1 / of_edges), weights).optimize(covariances=False)
        graph = graph.at(solution.trajectory.T_world_sensor)
        if edges_too:
            of_edges = np.minimum(1.0, (TAILS + 6) / (TAILS + graph.residuals() ** 2))
        before, weights = weights, weights_at(graph)
        if np.abs(weights - before).max() < _MIN_CHANGE:
            break
    assert solution is not None
    solution = solution.with_covariances()
    return replace(solution, graph=replace(solution.graph, edges=graph.edges)), weights


def sigmas_if_wrong(apart: np.ndarray, covariance: np.ndarray) -> float | None:
    """Mahalanobis distance of a measurement from the estimate; None if a right one can be as far off."""
    squared = float(apart @ np.linalg.solve(covariance, apart))
    return float(np.sqrt(squared)) if squared > chi_squared_beyond(_FAR, len(apart)) else None


@dataclass(frozen=True, slots=True)
class _Fixes:
    """Fixes of n poses, of the K kinds of KINDS."""

    poses: np.ndarray  # (n,) int
    priors: tuple[PosePrior, ...]  # n
    measured: MeasuredPoses
    sigmas: np.ndarray  # (n, 6) as of a `PosePrior`
    known: np.ndarray  # (n, K) bool, whether the kind was measured

    @classmethod
    def of(cls, priors: Mapping[int, PosePrior]) -> "_Fixes":
        measured = MeasuredPoses.of(priors)
        those = tuple(priors[k] for k in measured.poses.tolist())
        sigmas = np.stack([prior.sigmas for prior in those])
        known = np.column_stack([np.isfinite(sigmas[:, numbers]).all(axis=1) for numbers in KINDS.values()])
        return cls(measured.poses, those, measured, sigmas, known)

    def weighed(self, weights: np.ndarray) -> list[PosePrior]:
        """The priors with sigmas enlarged by (n, K) weights."""
        sigmas = self.sigmas.copy()
        for kind, numbers in enumerate(KINDS.values()):
            sigmas[:, numbers] /= np.sqrt(weights[:, kind, None])
        return [replace(prior, sigmas=own) for prior, own in zip(self.priors, sigmas, strict=True)]

    def scaled(self, factors: np.ndarray) -> "_Fixes":
        """With standard deviations multiplied by (K,) factors."""
        if (factors == 1).all():
            return self
        sigmas = self.sigmas.copy()
        for numbers, factor in zip(KINDS.values(), factors.tolist(), strict=True):
            sigmas[:, numbers] *= factor
        priors = tuple(replace(prior, sigmas=own.copy()) for prior, own in zip(self.priors, sigmas, strict=True))
        return replace(self, priors=priors, sigmas=sigmas)

    def know_tilt(self, solution: Solution) -> bool:
        """Whether attitudes were measured, or the tilt is certain by other measurements."""
        if self.known[:, 0].any():
            return True
        if any(free[:2].any() for free in solution.graph.gauge.unmeasured.values()):
            return False
        R = solution.trajectory.T_world_sensor.rotation.as_matrix()
        in_world = R @ solution.covariances()[:, :3, :3] @ R.swapaxes(1, 2)
        return float(np.linalg.eigvalsh(in_world[self.poses, :2, :2])[:, -1].min()) <= _MAX_TILT_SIGMA**2

    def suffice_for(self, free: tuple[int, ...]) -> bool:
        """Whether there are enough fixes to estimate an error of these numbers."""
        _, headed, placed, deep = self.known.sum(axis=0)
        enough = placed >= _MIN_FIXES or (free == (SCALE,) and deep >= _MIN_FIXES)
        return bool(enough and (2 not in free or headed >= _MIN_FIXES))

    def shared_error(self, at: Solution, weights: np.ndarray, error: Systematic | None = None) -> SharedError:
        """The cost of a systematic error at the optimum with (n, K) weights; `error` is already corrected."""
        precisions = np.zeros((len(self.poses), 6))
        for kind, numbers in enumerate(KINDS.values()):
            precisions[:, numbers] = np.where(self.known[:, kind], weights[:, kind], 0.0)[:, None]
        precisions /= self.sigmas**2
        residuals = self.residuals(at.trajectory.T_world_sensor)
        before = error or Systematic()
        try:
            return SharedError.of(at.trajectory, at.information(), self.poses, residuals, precisions, before)
        except RuntimeError as singular:
            raise at.graph.unsolvable(singular) from singular

    def apart(self, one: Solution, other: Solution) -> float:
        """Mean distance between the measured poses of two optima [sigmas of the positions]."""
        places = (each.trajectory.T_world_sensor.translation[self.poses, :2] for each in (one, other))
        far = np.linalg.norm(np.subtract(*places), axis=1) / self.sigmas[:, 3:5].mean(axis=1)
        return float(far.mean())

    def cost(self, solution: Solution) -> float:
        """Twice the negative logarithm of the likelihood of edges and fixes, by Student's t."""
        squared = self._squared(solution.trajectory.T_world_sensor)
        of_fixes = ((TAILS + _SIZES) * np.log1p(squared / TAILS))[self.known].sum()
        of_edges = ((TAILS + 6) * np.log1p(solution.graph.residuals() ** 2 / TAILS)).sum()
        return float(of_fixes + of_edges)

    def corrected(self, error: Systematic, at: Trajectory) -> "_Fixes":
        """Without a systematic error; `at` is an estimate of all poses."""
        T = error.corrected(RigidTransform.concatenate([p.T_world_sensor for p in self.priors]), at, self.poses)
        return _Fixes.of(
            {
                k: replace(p, T_world_sensor=T[n])
                for n, (k, p) in enumerate(zip(self.poses.tolist(), self.priors, strict=True))
            }
        )

    def weights_at(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, K) weights by the distance of poses from fixes, relative to the median one of each kind."""
        usual = np.maximum(1.0, self._usual(sums := self._squared(T_world_sensor)))
        return np.minimum(1.0, (TAILS + _SIZES) / (TAILS + sums / usual)) / usual

    def understated(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(K,) ratio of actual to stated errors of each kind, 1 if they are about as stated."""
        factors = np.sqrt(self._usual(self._squared(T_world_sensor)))
        return np.where(factors >= _UNDERESTIMATED, factors, 1.0)

    def fit(self, T_world_sensor: RigidTransform, kinds: Sequence[int]) -> bool:
        """Whether fixes of these kinds have about the stated errors, and few are far off."""
        far = (self._squared(T_world_sensor) > chi_squared_beyond(_FAR, _SIZES)) & self.known
        few = far.sum(axis=0) <= _MAX_WRONG * self.known.sum(axis=0)
        return bool(((self.understated(T_world_sensor) == 1) & few)[list(kinds)].all())

    def _squared(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, K) chi-squared of the fixes."""
        squared = (self.residuals(T_world_sensor) / self.sigmas) ** 2
        return np.column_stack([squared[:, numbers].sum(axis=1) for numbers in KINDS.values()])

    def _usual(self, squared: np.ndarray) -> np.ndarray:
        """(K,) ratio of the actual to the stated variance by the median of each kind; 1 for too few fixes."""
        enough = self.known.sum(axis=0) >= _MIN_FIXES
        middle = [
            np.median(own[known]) if many else 0.0
            for own, known, many in zip(squared.T, self.known.T, enough, strict=True)
        ]
        return np.where(enough, np.array(middle) / _MEDIANS, 1.0)

    def residuals(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, 6) residuals of the fixes, as errors of a `PosePrior` [rad, m]."""
        return self.measured.residuals(T_world_sensor[self.poses])


def _wrong_fixes(solution: Solution, fixes: _Fixes, weights: np.ndarray) -> tuple[WrongFix, ...]:
    suspects = np.argwhere(fixes.known & (weights < 1.0))
    if not len(suspects):
        return ()
    T, covariances, wrong = solution.trajectory.T_world_sensor, solution.covariances(), list[WrongFix]()
    residuals, names = fixes.residuals(T), list(KINDS)
    for n, kind in suspects.tolist():
        numbers, k = KINDS[names[kind]], int(fixes.poses[n])
        R = T[k].rotation
        own = Rotation.from_euler("Z", -twist(R)) * R  # the axes of errors of roll, pitch and heading
        J = block_diag(own.as_matrix(), R.as_matrix())[numbers]  # by the pose's body tangent
        together = J @ covariances[k] @ J.T + np.diag(fixes.sigmas[n, numbers] ** 2)
        if (sigmas := sigmas_if_wrong(residuals[n, numbers], together)) is not None:
            place = tuple(fixes.measured.T_world_pose.translation[n, :2].tolist())
            wrong.append(WrongFix(k, names[kind], sigmas, place if names[kind] == "position" else None))
    return tuple(sorted(wrong, key=lambda fix: (fix.scan, fix.kind)))


def _too_many(wrong: Sequence[WrongFix], fixes: _Fixes) -> bool:
    """Whether too many fixes of a kind seem wrong: then the edges are."""
    return any(
        sum(fix.kind == name for fix in wrong) > _MAX_WRONG * fixes.known[:, kind].sum()
        for kind, name in enumerate(KINDS)
    )


def without_kinds(prior: PosePrior, kinds: Collection[str]) -> PosePrior | None:
    """A prior without some kinds of KINDS; None if it has no others."""
    if not kinds:
        return prior
    sigmas = prior.sigmas.copy()
    for kind in kinds:
        sigmas[KINDS[kind]] = np.inf
    return replace(prior, sigmas=sigmas) if np.isfinite(sigmas).any() else None
