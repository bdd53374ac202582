"""Measurements that all others contradict: an acoustic outlier, a compass that jumped.

They are found by reweighted least squares with heavy tails (Student's t): a measurement far off pulls less and less,
until the others say where the pose is. One that nothing else bears on is never wrong.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.decide.systematic import KINDS_OF_ERROR, SharedError, Systematic
from sonarmap.slam.graph.known_pose import MeasuredPoses
from sonarmap.slam.graph.pose_graph import PoseGraph, Solution
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.chi_squared import chi_squared, chi_squared_beyond
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior

# What an instrument tells, and its numbers among a prior's sigmas.
KINDS = {"attitude": slice(0, 2), "heading": slice(2, 3), "position": slice(3, 5), "depth": slice(5, 6)}
_SIZES = np.array([numbers.stop - numbers.start for numbers in KINDS.values()])
_MIDDLE = chi_squared(0.5, _SIZES)  # the median of chi-squared with a degree of freedom for each size
# Degrees of freedom of the errors' tails, how often measurements are weighed anew, and a change that is none.
TAILS, _REWEIGHTED, _SETTLED = 2.0, 12, 1e-2
# A measurement is wrong where one of so many right ones is as far off.
_RARE = 1e-5
# Where more than this share of the measurements of a kind seem wrong, it is not they that are.
_MOST = 0.4
# Standard deviations of a kind are understated where the errors of half of so many or more are as large as those of so
# many times as large ones; from so many times on nothing is measured: axes are exchanged, or times are off.
_FEWEST, _UNDERSTATED, NOTHING = 8, 2.0, 10.0
# An error that all fixes share is looked for where a first look lets chi-squared fall by so much, and believed where it
# falls by so much in the end, and so much more than by another that leaves the poses elsewhere, by so many of the
# positions' sigmas in the mean.
_LOOKED_AT, _EXPLAINS, _CLEARLY, _ELSEWHERE = 5.0, 15.0, 15.0, 3.0
# What fits with it then, as depths and attitudes have nothing to do with it; and the share of these that may still be
# farther off than one of so many right ones.
_EXPLAINED = [list(KINDS).index(kind) for kind in ("heading", "position")]
_MOST_LEFT, _RARELY = 0.2, 1e-4
_STEPS, _STILL = 8, 0.02  # it is found in at most so many steps, the last of which is so small a share of it
_SURE_TILT = float(np.deg2rad(3.0))  # a tilt that is less sure is no ground for an error that all share [rad]


@dataclass(frozen=True, slots=True)
class WrongFix:
    """A measurement that was left out."""

    scan: int  # its index
    kind: str  # of KINDS
    sigmas: float  # how far it is from what all others say, in standard deviations of one number that is as rare
    place: tuple[float, ...] | None = None  # where a position said that the sensor was, East and North [m]


@dataclass(frozen=True, slots=True)
class JudgedFixes:
    """What instruments measured, as far as everything else bears it out."""

    priors: dict[int, PosePrior]  # by pose, without what is wrong, and as sure as it shows itself to be
    wrong: tuple[WrongFix, ...] = ()
    # by kind, by how much larger its errors are than stated; from `NOTHING` on the kind is left out
    understated: Mapping[str, float] = field(default_factory=dict[str, float])
    systematic: Systematic | None = None  # what all were off by; the priors are without it


def judge_fixes(graph: PoseGraph, priors: Mapping[int, PosePrior]) -> JudgedFixes:
    """The priors without those that the edges and the other priors contradict, and as sure as these leave them.

    Args:
        graph: edges between the poses, these about where they are in the world; its own priors do not count.
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
    """By kind, how many measurements are used, of how many, and their distance from the poses in the median [sigmas].

    Args:
        priors: those that are used, by pose.
        wrong: those that are left out.
        T_world_sensor: the poses.
    """
    if not priors:
        return {}
    fixes = _Fixes.of(priors)
    sigmas = np.sqrt(fixes._squared(T_world_sensor) / _SIZES)
    told: dict[str, tuple[int, int, float]] = {}
    for kind, own, known in zip(KINDS, sigmas.T, fixes.known.T, strict=True):
        if known.any():
            used, left_out = int(known.sum()), sum(fix.kind == kind for fix in wrong)
            told[kind] = used, used + left_out, float(np.median(own[known]))
    return told


@dataclass(frozen=True, slots=True)
class _Explanation:
    """An error that all fixes may share, and the optimum without it."""

    error: Systematic
    fixes: "_Fixes"  # corrected
    at: Solution  # their optimum with the edges
    weights: np.ndarray  # (n, K) of the fixes there
    cost: float  # twice the negative logarithm of the likelihood
    fits: bool  # whether a vehicle can have it, and fixes and edges fit then

    @property
    def look(self) -> SharedError:
        """What changes of the error would explain."""
        return self.fixes.shared_error(self.at, self.weights, self.error)

    def with_alternative(self, others: Sequence["_Explanation"]) -> "_Explanation":
        """With one of the others that fits about as well and leaves the poses elsewhere, if there is any."""
        close = (other for other in others if other.fits and other.cost < self.cost + _CLEARLY)
        unclear = next((other.error for other in close if self.fixes.apart(self.at, other.at) > _ELSEWHERE), None)
        return replace(self, error=replace(self.error, alternative=unclear))


def _explained(graph: PoseGraph, plain: _Explanation) -> _Explanation:
    """The error that all fixes share: one kind, and others beside it as long as each explains clearly more.

    A tilt that nobody knows would be taken for a lever arm: then none is looked for. It is looked for beside the
    `plain` optimum, and beside one of edges that count in full: one of these would rather give way than all fixes.
    """
    if not plain.fixes.tell_tilt(plain.at):
        return plain
    best = found = plain
    looks, free = [plain.look, plain.fixes.shared_error(*_solved(graph, plain.fixes, edges_too=False))], ()
    while True:
        tried: list[tuple[_Explanation, tuple[int, ...]]] = []
        for kind in (kind for kind in KINDS_OF_ERROR if kind[0] not in free and plain.fixes.tell_error(kind)):
            numbers = (*free, *kind)
            fall, step = max((look.step(numbers) for look in looks), key=lambda look: look[0])
            if fall >= _LOOKED_AT:
                more = _explanation(graph, plain, best, step, numbers)
                if best.cost - more.cost >= _EXPLAINS:
                    tried.append((more, numbers))
        if not tried:
            return _without_needless(graph, plain, found)
        tried.sort(key=lambda each: (not each[0].fits, each[0].cost))
        best, free = tried[0]
        looks = [best.look]
        if best.fits:
            found = best.with_alternative([each for each, _ in tried[1:]])


def _without_needless(graph: PoseGraph, plain: _Explanation, found: _Explanation) -> _Explanation:
    """The explanation without kinds of error that the others, found later, make needless."""
    kinds = [kind for kind in KINDS_OF_ERROR if found.error.numbers[list(kind)].any()]
    needed = [kind for kind in kinds if found.look.rise_without(kind, kinds, found.error) >= _EXPLAINS]
    if not needed or len(needed) == len(kinds):
        return found
    free = tuple(number for kind in needed for number in kind)
    numbers = np.where(np.isin(np.arange(len(found.error.numbers)), free), found.error.numbers, 0.0)
    start = replace(found, error=Systematic(*numbers.tolist()))
    without = _explanation(graph, plain, start, np.zeros(len(numbers)), free)
    return without if without.fits else found


def _explanation(
    graph: PoseGraph, plain: _Explanation, before: _Explanation, step: np.ndarray, free: tuple[int, ...]
) -> _Explanation:
    """The error of the `free` numbers, by Gauss-Newton steps from the one `before` on, the first of them given."""
    error, fixes, at, weights = before.error, before.fixes, before.at, before.weights
    for _ in range(_STEPS):
        error = Systematic(*(error.numbers + step).tolist())
        fixes = plain.fixes.corrected(error, at.trajectory)
        at, weights = _solved(graph, fixes)
        _, step = fixes.shared_error(at, weights, error).step(free)
        if np.abs(step).max() < _STILL * np.abs(error.numbers).max():
            break
    # where edges are wrong, as over a flat bed, or some fixes are, some arm explains a part; one that is there puts no
    # strain on edges
    fits = error.is_likely and _strained(at) <= _strained(plain.at)
    fits = fits and fixes.fit(at.trajectory.T_world_sensor, _EXPLAINED)
    return _Explanation(error, fixes, at, weights, fixes.cost(at) + error.unlikeliness, fits)


def _strained(solution: Solution) -> int:
    """How many edges are farther off than one of 10,000 right ones."""
    return int((solution.graph.residuals() ** 2 > chi_squared_beyond(_RARELY, 6)).sum())


def _solved(graph: PoseGraph, fixes: "_Fixes", edges_too: bool = True) -> tuple[Solution, np.ndarray]:
    """The optimum of edges and fixes, and the fixes' weights there."""

    def weighed(graph: PoseGraph, weights: np.ndarray) -> PoseGraph:
        return replace(graph, priors=tuple(zip(fixes.poses.tolist(), fixes.weighed(weights), strict=True)))

    def weights_at(graph: PoseGraph) -> np.ndarray:
        return np.where(fixes.known, fixes.weights_at(graph.trajectory.T_world_sensor), 1.0)

    # a fix far off would tear its scan from the edges, did it count in full first; those may be wrong as well
    start = weights_at(graph)
    start /= np.where(fixes.known, start, 0.0).max(axis=0, initial=1e-12)
    return reweighted(graph, np.minimum(start, 1.0), weighed, weights_at, edges_too)


def reweighted(
    graph: PoseGraph,
    weights: np.ndarray,
    weighed: Callable[[PoseGraph, np.ndarray], PoseGraph],
    weights_at: Callable[[PoseGraph], np.ndarray],
    edges_too: bool = False,
) -> tuple[Solution, np.ndarray]:
    """The optimum, and the measurements' weights there: `weighed` gives a graph whose measurements count by these, and
    `weights_at` the weights by how far a graph's poses are from what was measured."""
    solution, scale_factors = None, np.ones(len(graph.edges))
    of_edges = 1 / scale_factors
    for _ in range(_REWEIGHTED):
        scale_factors = 1 / of_edges
        solution = weighed(graph, weights).optimize(covariances=False, scale_factors=scale_factors)
        graph = graph.at(solution.trajectory.T_world_sensor)
        if edges_too:
            of_edges = np.minimum(1.0, (TAILS + 6) / (TAILS + solution.residuals**2 / of_edges))
        before, weights = weights, weights_at(graph)
        if np.abs(weights - before).max() < _SETTLED:
            break
    assert solution is not None
    return solution.with_covariances(scale_factors), weights


def sigmas_if_wrong(apart: np.ndarray, covariance: np.ndarray) -> float | None:
    """How far a measurement is from the estimate [sigmas], where that is farther than both are unsure."""
    squared = float(apart @ np.linalg.solve(covariance, apart))
    return float(np.sqrt(squared)) if squared > chi_squared_beyond(_RARE, len(apart)) else None


@dataclass(frozen=True, slots=True)
class _Fixes:
    """What was measured of n poses, by the K kinds of KINDS."""

    poses: np.ndarray  # (n,) int
    priors: tuple[PosePrior, ...]  # n
    measured: MeasuredPoses
    sigmas: np.ndarray  # (n, 6) as of a `PosePrior`
    known: np.ndarray  # (n, K) bool, what was measured

    @classmethod
    def of(cls, priors: Mapping[int, PosePrior]) -> "_Fixes":
        measured = MeasuredPoses.of(priors)
        those = tuple(priors[k] for k in measured.poses.tolist())
        sigmas = np.stack([prior.sigmas for prior in those])
        known = np.column_stack([np.isfinite(sigmas[:, numbers]).all(axis=1) for numbers in KINDS.values()])
        return cls(measured.poses, those, measured, sigmas, known)

    def weighed(self, weights: np.ndarray) -> list[PosePrior]:
        """The priors with what weighs less, (n, K), less sure."""
        sigmas = self.sigmas.copy()
        for kind, numbers in enumerate(KINDS.values()):
            sigmas[:, numbers] /= np.sqrt(weights[:, kind, None])
        return [replace(prior, sigmas=own) for prior, own in zip(self.priors, sigmas, strict=True)]

    def scaled(self, factors: np.ndarray) -> "_Fixes":
        """With (K,) times larger standard deviations."""
        if (factors == 1).all():
            return self
        sigmas = self.sigmas.copy()
        for numbers, factor in zip(KINDS.values(), factors.tolist(), strict=True):
            sigmas[:, numbers] *= factor
        priors = tuple(replace(prior, sigmas=own.copy()) for prior, own in zip(self.priors, sigmas, strict=True))
        return replace(self, priors=priors, sigmas=sigmas)

    def tell_tilt(self, solution: Solution) -> bool:
        """Whether attitudes were measured, or the tilt is about as sure by the rest."""
        if self.known[:, 0].any():
            return True
        if any(free[:2].any() for free in solution.graph.gauge.unmeasured.values()):
            return False
        R = solution.trajectory.T_world_sensor.rotation.as_matrix()
        in_world = R @ solution.covariances()[:, :3, :3] @ R.swapaxes(1, 2)
        return float(np.linalg.eigvalsh(in_world[self.poses, :2, :2])[:, -1].min()) <= _SURE_TILT**2

    def tell_error(self, free: tuple[int, ...]) -> bool:
        """Whether enough was measured to tell an error of these numbers."""
        _, headed, placed, _ = self.known.sum(axis=0)
        return bool(placed >= _FEWEST and (2 not in free or headed >= _FEWEST))

    def shared_error(self, at: Solution, weights: np.ndarray, error: Systematic | None = None) -> SharedError:
        """What all may be off by, beside their optimum with (n, K) weights; `error`: what was taken off before."""
        precisions = np.zeros((len(self.poses), 6))
        for kind, numbers in enumerate(KINDS.values()):
            precisions[:, numbers] = np.where(self.known[:, kind], weights[:, kind], 0.0)[:, None]
        precisions /= self.sigmas**2
        residuals = self.residuals(at.trajectory.T_world_sensor)
        return SharedError.of(at.trajectory, at.information(), self.poses, residuals, precisions, error or Systematic())

    def apart(self, one: Solution, other: Solution) -> float:
        """How far the measured poses of two optima are apart in the mean [sigmas of the positions]."""
        places = (each.trajectory.T_world_sensor.translation[self.poses, :2] for each in (one, other))
        far = np.linalg.norm(np.subtract(*places), axis=1) / self.sigmas[:, 3:5].mean(axis=1)
        return float(far.mean())

    def cost(self, solution: Solution) -> float:
        """Of the edges and these: twice the negative logarithm of the likelihood of their tails."""
        squared = self._squared(solution.trajectory.T_world_sensor)
        of_fixes = ((TAILS + _SIZES) * np.log1p(squared / TAILS))[self.known].sum()
        of_edges = ((TAILS + 6) * np.log1p(solution.graph.residuals() ** 2 / TAILS)).sum()
        return float(of_fixes + of_edges)

    def corrected(self, error: Systematic, at: Trajectory) -> "_Fixes":
        """Without what all are off by, beside an estimate of all poses."""
        T = error.corrected(RigidTransform.concatenate([p.T_world_sensor for p in self.priors]), at, self.poses)
        return _Fixes.of(
            {
                k: replace(p, T_world_sensor=T[n])
                for n, (k, p) in enumerate(zip(self.poses.tolist(), self.priors, strict=True))
            }
        )

    def weights_at(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, K) weights by how far the poses are from what was measured, beside what most of the kind are."""
        usual = np.maximum(1.0, self._usual(sums := self._squared(T_world_sensor)))
        return np.minimum(1.0, (TAILS + _SIZES) / (TAILS + sums / usual)) / usual

    def understated(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(K,) by how much larger the errors of each kind are than stated, 1 where they are about as stated."""
        factors = np.sqrt(self._usual(self._squared(T_world_sensor)))
        return np.where(factors >= _UNDERSTATED, factors, 1.0)

    def fit(self, T_world_sensor: RigidTransform, kinds: Sequence[int]) -> bool:
        """Whether most measurements of these kinds are about as far from the poses as was stated, and few farther."""
        far = (self._squared(T_world_sensor) > chi_squared_beyond(_RARELY, _SIZES)) & self.known
        few = far.sum(axis=0) <= _MOST_LEFT * self.known.sum(axis=0)
        return bool(((self.understated(T_world_sensor) == 1) & few)[list(kinds)].all())

    def _squared(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, K) chi-squared of what was measured."""
        squared = (self.residuals(T_world_sensor) / self.sigmas) ** 2
        return np.column_stack([squared[:, numbers].sum(axis=1) for numbers in KINDS.values()])

    def _usual(self, squared: np.ndarray) -> np.ndarray:
        """(K,) the variance that half of each kind show, over the stated; 1 of too few."""
        enough = self.known.sum(axis=0) >= _FEWEST
        middle = [
            np.median(own[known]) if many else 0.0
            for own, known, many in zip(squared.T, self.known.T, enough, strict=True)
        ]
        return np.where(enough, np.array(middle) / _MIDDLE, 1.0)

    def residuals(self, T_world_sensor: RigidTransform) -> np.ndarray:
        """(n, 6) how far poses are from what was measured, as errors of a `PosePrior` [rad, m]."""
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
    """Whether so many fixes of a kind seem wrong that rather the edges are."""
    return any(
        sum(fix.kind == name for fix in wrong) > _MOST * fixes.known[:, kind].sum() for kind, name in enumerate(KINDS)
    )


def without_kinds(prior: PosePrior, kinds: Collection[str]) -> PosePrior | None:
    """A prior without some kinds of KINDS; None where nothing is left."""
    if not kinds:
        return prior
    sigmas = prior.sigmas.copy()
    for kind in kinds:
        sigmas[KINDS[kind]] = np.inf
    return replace(prior, sigmas=sigmas) if np.isfinite(sigmas).any() else None
