"""Fit of the probability and the covariance of registrations to recorded pairs of every kind, tested on pairs that the
fit does not use."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform
from scipy.special import expit

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.covariance import ELLIPSOID, Slide, fit_covariance, slides_of
from sonarmap.spectral.fitted import FITTED, TABLE
from sonarmap.spectral.geometry import cross_matrices
from sonarmap.spectral.grid import choose_grid, coarse_edge
from sonarmap.spectral.judgement import Clues, Odds, fixed_probability, judge, shares
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.verify.bounds import NEAR_SHIFT, NEAR_TURN
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.reproduce.evidence import DRAWS, UNRELATED, RecordedPair, Recording, draw, recorded_pairs
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, as_asked
from sonarmap.tools.lab.simulate.kinds.catalog import kind_pair
from sonarmap.tools.methods.fingerprint import fingerprint

CLUES = tuple(field.name for field in fields(Clues))
NEAR = (float(np.degrees(NEAR_TURN)), NEAR_SHIFT)  # largest errors of a right place [degrees, voxels]
_RIDGE = 1e-3  # weight of the squared weights in the mean loss, for columns of standard deviation 1
_RARE = 0.005  # quantile of a clue at which its range is cut, on either side
# Largest errors of a right place within its covariance's ellipsoid [degrees, voxels]
_FARTHEST = (30.0, 40.0)
# Scans have slid if their error exceeds both bounds and is within the reach of the correlation
_SLID_SIGMAS = 2.5  # standard deviations by the planes alone
_SLID_COARSE = 1.5  # coarse voxels
_REACH_COARSE = 12.0  # coarse voxels


def fit_logistic(
    columns: np.ndarray, right: np.ndarray, share: np.ndarray | float = 1.0, start: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Constant and weights of log odds linear in (N, M) columns of standard deviation 1, by maximum likelihood.

    Each row is `right` with the probability of its odds times its share. A ridge penalty keeps the weights finite. The
    optimization begins at `start` (M + 1,), weights and constant.
    """
    x = np.column_stack([columns, np.ones(len(columns))])
    ridge = np.append(np.full(columns.shape[1], _RIDGE), _RIDGE**2)

    def probability(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        clear = expit(x @ weights)
        return np.clip(clear * share, 1e-9, 1 - 1e-9), share * clear * (1 - clear)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        p, slope = probability(weights)
        value = -np.where(right, np.log(p), np.log1p(-p)).mean() + ridge @ weights**2 / 2
        return float(value), x.T @ (np.where(right, -1 / p, 1 / (1 - p)) * slope) / len(x) + ridge * weights

    def information(weights: np.ndarray) -> np.ndarray:
        p, slope = probability(weights)
        return (x.T * (slope**2 / (p * (1 - p)))) @ x / len(x) + np.diag(ridge)

    begin = np.zeros(x.shape[1]) if start is None else start
    solution = minimize(loss, begin, jac=True, hess=information, method="trust-krylov").x
    return float(solution[-1]), solution[:-1]


@dataclass(frozen=True, slots=True)
class JudgedPairs:
    """N recorded pairs with the inputs of their probability."""

    pairs: Sequence[RecordedPair]
    clues: np.ndarray  # (N, K) their CLUES
    share: np.ndarray  # (N,) share of the probability that the score of the best hypothesis gives it
    nees: np.ndarray  # (N,) normalized squared error; NaN without a true pose
    fixed: np.ndarray  # (N,) probability that the pose is within the bounds of acceptance if its place is right
    sigma: np.ndarray  # (N,) largest standard deviation of the translation along any direction [voxels]

    @property
    def near(self) -> np.ndarray:
        """(N,) bool: whether the place is right by NEAR, whatever the covariance."""
        return np.array([(pair.off[0] <= NEAR).all() for pair in self.pairs])

    @property
    def right(self) -> np.ndarray:
        """(N,) bool: whether the place is right by NEAR, or within its 95 % ellipsoid and _FARTHEST."""
        off = np.array([pair.off[0] for pair in self.pairs])
        return self.near | ((self.nees <= ELLIPSOID) & (off <= _FARTHEST).all(axis=1))

    def probability(self, odds: Odds) -> np.ndarray:
        """(N,) probability that the best hypothesis has the right place."""
        return expit(odds.of(self.clues)) * self.share


def fit_odds(pairs: JudgedPairs, some: np.ndarray | slice = slice(None), start: Odds | None = None) -> Odds:
    """Odds fitted to some of the pairs, each of which is right with the probability of its odds times its share.

    The odds of nearly the same pairs are a good `start`.
    """
    clues = pairs.clues[some]
    low, high = np.quantile(clues, [_RARE, 1 - _RARE], axis=0)
    within = np.clip(clues, low, high)
    deviation = within.std(axis=0)
    odds = Odds(CLUES, low, high, within.mean(axis=0), np.where(deviation > 0, deviation, 1.0))
    begin = None if start is None or start.weights is None else np.append(start.weights, start.constant)
    constant, weights = fit_logistic(odds.columns(clues), pairs.right[some], pairs.share[some], begin)
    return replace(odds, constant=constant, weights=weights)


def judged(pairs: Sequence[RecordedPair], slide: Slide) -> JudgedPairs:
    """The pairs, evaluated by the rules of the package with another model of sliding."""
    rows = []
    for pair in pairs:
        best, voxel = pair.hypotheses[0], pair.grid.voxel
        covariance = fit_covariance(best, pair.centers, pair.grid, pair.seen, slide)
        search = float(pair.cells["search"])
        kept, _, clues = judge(pair.hypotheses, pair.T, covariance.posterior, pair.seen, pair.grid, search)
        share = shares([pair.hypotheses[n] for n in kept])[0]
        nees = float(pair.xi @ np.linalg.solve(covariance.posterior, pair.xi))
        fixed = fixed_probability(covariance.posterior, voxel, covariance.by_instruments)
        sigma = np.sqrt(np.linalg.eigvalsh(covariance.posterior[3:, 3:])[-1]) / voxel
        rows.append((*asdict(clues).values(), share, nees, fixed, sigma))
    table = np.array(rows).reshape(len(pairs), len(CLUES) + 4)
    return JudgedPairs(pairs, table[:, : len(CLUES)], *table[:, len(CLUES) :].T)


def fit_slide(pairs: Sequence[RecordedPair]) -> Slide:
    """The model of sliding, fitted to pairs whose error is within NEAR in rotation and the correlation's reach."""
    slides, slid, far = [], [], []
    for pair in pairs:
        voxel, coarse = pair.grid.voxel, pair.grid.edge / coarse_edge(pair.grid.edge)
        if pair.off[0, 0] > NEAR[0] or pair.off[0, 1] > _REACH_COARSE * coarse:
            continue
        covariance = fit_covariance(pair.hypotheses[0], pair.centers, pair.grid).posterior
        R, center = pair.hypotheses[0].fit.R, pair.centers[1]
        # shift of the source's grid center by the error at the sensor, along the axes [voxels]
        along = pair.seen.axes.T @ R.as_matrix() / voxel
        moved = along @ (RigidTransform.from_exp_coords(pair.xi).apply(center) - center)
        jacobian = along @ np.hstack([-cross_matrices(center[None])[0], np.eye(3)])
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian))
        slides.append(slides_of(pair.seen)[:, 0])
        slid.append((np.abs(moved) > _SLID_SIGMAS * sigma) & (np.abs(moved) > _SLID_COARSE * coarse))
        far.append(moved / coarse)
    distances = np.concatenate(far)[np.concatenate(slid)]
    odds, weights = fit_logistic(np.concatenate(slides)[:, None], np.concatenate(slid))
    return Slide(odds, float(weights[0]), float(np.sqrt(np.mean(distances**2))) if len(distances) else 0.0)


# Neither evaluations nor tests use pairs of this seed
_USUAL = {"counts": DRAWS, "seed": 880_301, "edge": 128}
# Modules that affect the recorded evidence. Modules that evaluate it can change without new recordings.
_MEASURING = ("registration", "grid", "scan", "expected", "prior", "so3", "geometry", "translation")
SOURCES = (
    *("kernels", "spectral/prepare", "spectral/verify", *(f"spectral/{name}.py" for name in _MEASURING)),
    *("tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("evidence", "pairs", "registrations")),
)
_FOLDS = 5
HELD_OUT = "other pairs"  # values of the column "fitted_to": fitted to pairs of the other folds, or of the other sets
SET_HELD_OUT = "other sets"
# Reference pairs, whose clues the table keeps: if they change, the fit is out of date
_KIND = "patch"
_NUMBERS = (1, 3, 4)
_SEED = 880_302
_EDGE = 64
# Clues that do not depend on the table itself
_MEASURED = ("psr", "view", "surface", "sharpness", "firmness", "overlap", "slide_0", "slide_1", "slide_2", "turn_0")


def create(request: Request) -> Experiment:
    """A job is one draw of a set, as swath-0003; `quick` runs one draw of each set on grids of half the edge."""
    draws = request.pairs or (1 if request.quick else None)
    counts = DRAWS if draws is None else dict.fromkeys(DRAWS, draws)
    settings = as_asked(request, _USUAL | {"counts": counts}, {"edge": 64})

    def run(job: str) -> Outcome:
        name, _, number = job.partition("-")
        recording = Recording(request.opened)
        pairs = draw(name, int(number), settings.seed, settings.edge)
        return Outcome(tuple(row for pair in pairs for row in recording.rows(pair)))

    write = partial(_write, device=request.opened)
    return Experiment("confidence", settings, _in_turns(counts), run, SOURCES, conclude=fitted_and_tested, write=write)


def _in_turns(counts: Mapping[str, int]) -> list[str]:
    """The jobs of all sets, interleaved, so that an interrupted run has some of each."""
    numbered = [(number / count, f"{name}-{number:04d}") for name, count in counts.items() for number in range(count)]
    return [job for _, job in sorted(numbered)]


def fitted_and_tested(rows: Sequence[Row]) -> list[Row]:
    """Rows of the confidence on recorded pairs that a fit did not use; the first row also has the fit to all of them.

    Pairs that bounds refuse are left out, as no probability is right or wrong about them.
    """
    recorded = [pair for pair in recorded_pairs(rows) if not pair.cells["refused"]]
    slide = fit_slide([pair for pair in recorded if pair.cells["related"]])
    pairs = judged(recorded, slide)
    folds = np.array([int(pair.cells["number"]) % _FOLDS for pair in recorded])
    sets = np.array([pair.cells["set"] for pair in recorded])
    by_set = np.where(sets == UNRELATED, folds, -1 - np.unique(sets, return_inverse=True)[1])
    tested = [*_rows(pairs, _held_out(pairs, folds), HELD_OUT), *_rows(pairs, _held_out(pairs, by_set), SET_HELD_OUT)]
    fitted = {
        "probability": {"twin": FITTED["probability"]["twin"]} | fit_odds(pairs).to_json(),
        "slide": {name: round(value, 4) for name, value in asdict(slide).items()},
    }
    return [{**tested[0], "fitted": json.dumps(fitted), "evidence": fingerprint(rows)}, *tested[1:]]


def _write(rows: Sequence[Row], device: Device) -> str:
    """Write the table that the package reads, and return a message."""
    fitted = json.loads(str(rows[0]["fitted"]))
    made = {
        "by": "sonarmap reproduce confidence --write",
        "date": datetime.now(UTC).date().isoformat(),
        "pairs": int(rows[0]["pairs"]),
        "evidence": rows[0]["evidence"],
    }
    table = FITTED | fitted | {"made": made, "reference": reference(device)}
    lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(part)}" for name, part in table.items())
    with atomic_path(TABLE) as temporary:
        temporary.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    return f"the table is in {TABLE}; it applies from the next start"


def _held_out(pairs: JudgedPairs, groups: np.ndarray) -> np.ndarray:
    """(N,) probabilities of the pairs of each group by a fit to all others."""
    probability, whole = np.zeros(len(groups)), fit_odds(pairs)
    for group in np.unique(groups):
        inside = groups == group
        fitted = fit_odds(pairs, ~inside, whole) if (~inside).any() else whole
        probability[inside] = pairs.probability(fitted)[inside]
    return probability


def _rows(pairs: JudgedPairs, probability: np.ndarray, fitted_to: str) -> list[Row]:
    """Rows of the quality of probabilities and covariances, by group."""
    likely, right, near = probability >= SpectralConfig().least_probability, pairs.right, pairs.near
    accepted = likely & (pairs.fixed >= FITTED["acceptance"]["fixed"])
    tenth = np.minimum((10 * probability).astype(int), 9)
    rows: list[Row] = []
    for by in ("all", "known", "set", "scene", "edge"):
        values = np.array([str(pair.cells.get(by, "all pairs")) for pair in pairs.pairs])
        for value in np.unique(values).tolist():
            some = values == value
            gaps = [abs((right - probability)[some & (tenth == k)].sum()) for k in range(10)]
            nees = pairs.nees[some & near]
            rows.append(
                {
                    "fitted_to": fitted_to, "by": by, "group": value, "pairs": int(some.sum()),
                    "right": int((some & right).sum()), "likely_right": int((some & right & likely).sum()),
                    "likely_wrong": int((some & ~right & likely).sum()),
                    "accepted_right": int((some & right & accepted).sum()),
                    "accepted_wrong": int((some & ~right & accepted).sum()),
                    "calibration_error": float(sum(gaps) / some.sum()), "near": len(nees),
                    "inside": int((nees <= ELLIPSOID).sum()), "nees": float(nees.mean()) if len(nees) else np.nan,
                    "open": int((pairs.sigma[some & near] > 5).sum()),
                }
            )  # fmt: skip
    return rows


def reference(device: Device) -> dict[str, Any]:
    """The clues _MEASURED of the reference pairs, by the pairs' numbers."""
    clues = {}
    for number in _NUMBERS:
        pair = kind_pair(_KIND, number, _SEED)
        registrar = SpectralRegistrar(device, choose_grid((pair.target, pair.source), _EDGE))
        registration = registrar.register(registrar.prepare(pair.target), registrar.prepare(pair.source))
        evidence = dict(registration.evidence)
        clues[str(number)] = {name: round(evidence[f"p_{name}"], 3) for name in _MEASURED}
    return clues
