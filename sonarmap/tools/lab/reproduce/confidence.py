"""What the probability and the covariance of a registration are fitted to: pairs of every kind are registered, what
was measured of them is recorded, and the fit is tested on pairs that it has not seen."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
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
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.reproduce.evidence import (
    DISTORTED,
    STILL,
    SURVEY,
    UNRELATED,
    RecordedPair,
    Recording,
    draw,
    recorded_pairs,
)
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, as_asked
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.methods.fingerprint import fingerprint

CLUES = tuple(field.name for field in fields(Clues))
NEAR = (12.0, 8.0)  # a place is right within these of the truth [degrees, voxels]
_RIDGE = 1e-3  # weight of the squared weights in the mean loss, of columns with deviation 1
_RARE = 0.005  # share of the pairs on either side that say nothing of a clue's range
# A place that is farther off is wrong, whatever its covariance says [degrees, voxels]
_FARTHEST = (30.0, 40.0)
# Scans have slid if they are farther off than both bounds, within the reach of the correlation
_SLID_SIGMAS = 2.5  # standard deviations by their planes
_SLID_COARSE = 1.5  # coarse voxels
_REACH_COARSE = 12.0  # coarse voxels


def fit_odds(clues: np.ndarray, right: np.ndarray, share: np.ndarray, start: Odds | None = None) -> Odds:
    """From (N, K) clues of N pairs; each is `right` (N,) with the probability of these odds times its share (N,).

    Those of nearly the same pairs are a good `start`.
    """
    low, high = np.quantile(clues, [_RARE, 1 - _RARE], axis=0)
    within = np.clip(clues, low, high)
    deviation = within.std(axis=0)
    odds = Odds(CLUES, low, high, within.mean(axis=0), np.where(deviation > 0, deviation, 1.0))
    known = None if start is None or start.weights is None else np.append(start.weights, start.constant)
    constant, weights = fit_logistic(odds.columns(clues), right, share, known)
    return replace(odds, constant=constant, weights=weights)


def fit_logistic(
    columns: np.ndarray, right: np.ndarray, share: np.ndarray | float = 1.0, start: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Constant and weights of log odds by maximum likelihood, linear in (N, M) columns of a deviation of about 1.

    Each row is `right` with the probability of these odds times its share. A small weight on the squares of the weights
    keeps these finite. The search begins at `start` (M + 1,), weights and constant.
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
    found = minimize(loss, begin, jac=True, hess=information, method="trust-krylov").x
    return float(found[-1]), found[:-1]


@dataclass(frozen=True, slots=True)
class JudgedPairs:
    """N recorded pairs with their covariances, and what their probability is to be made of."""

    pairs: Sequence[RecordedPair]
    clues: np.ndarray  # (N, K) the CLUES of each
    share: np.ndarray  # (N,) of the probability that the best hypothesis has by its score
    nees: np.ndarray  # (N,) squared error over covariance; NaN where no pose is right
    fixed: np.ndarray  # (N,) probability that the pose is fixed
    sigma: np.ndarray  # (N,) standard deviation along the least sure direction [voxels]

    @property
    def near(self) -> np.ndarray:
        """(N,) whether the place is right, however sure the pose."""
        return np.array([(pair.off[0] <= NEAR).all() for pair in self.pairs])

    @property
    def right(self) -> np.ndarray:
        """(N,) whether the place is right, or as far off as the covariance says."""
        off = np.array([pair.off[0] for pair in self.pairs])
        return self.near | ((self.nees <= ELLIPSOID) & (off <= _FARTHEST).all(axis=1))

    def probability(self, odds: Odds) -> np.ndarray:
        """(N,) that the best hypothesis names the right place."""
        return expit(odds.of(self.clues)) * self.share


def judged(pairs: Sequence[RecordedPair], slide: Slide) -> JudgedPairs:
    """The pairs, by the rules of the package but for how far scans slide."""
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
    """How far scans slide, from pairs whose place is right as far as the correlation was looked at."""
    slides, slid, far = [], [], []
    for pair in pairs:
        voxel, coarse = pair.grid.voxel, pair.grid.edge / coarse_edge(pair.grid.edge)
        if pair.off[0, 0] > NEAR[0] or pair.off[0, 1] > _REACH_COARSE * coarse:
            continue
        covariance = fit_covariance(pair.hypotheses[0], pair.centers, pair.grid).posterior
        R, center = pair.hypotheses[0].fit.R, pair.centers[1]
        # what an error at the sensor moves the source's grid center by, along the axes
        along = pair.seen.axes.T @ R.as_matrix() / voxel
        moved = along @ (RigidTransform.from_exp_coords(pair.xi).apply(center) - center)
        jacobian = along @ np.hstack([-cross_matrices(center[None])[0], np.eye(3)])
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian))
        slides.append(slides_of(pair.seen)[:, 0])
        slid.append((np.abs(moved) > _SLID_SIGMAS * sigma) & (np.abs(moved) > _SLID_COARSE * coarse))
        far.append(moved / coarse)
    ways = np.concatenate(far)[np.concatenate(slid)]
    odds, weights = fit_logistic(np.concatenate(slides)[:, None], np.concatenate(slid))
    return Slide(odds, float(weights[0]), float(np.sqrt(np.mean(ways**2))) if len(ways) else 0.0)


# Draws of each set: one of a kind is registered five times, one of a survey 35 times. Neither the evaluations nor the
# tests use pairs of this seed. Of the still pairs a sixth has half of `edge` voxels per edge, another twice as many.
_COUNTS = dict.fromkeys(SCAN_KINDS, 300) | {STILL: 1200, UNRELATED: 1200, SURVEY: 240, DISTORTED: 300}
_USUAL = {"counts": _COUNTS, "seed": 880_301, "edge": 128}
# What measures, not what judges: a change of the latter is fitted and tested on what is recorded already.
_MEASURING = ("registration", "grid", "scan", "expected", "prior", "so3", "geometry", "translation")
SOURCES = (
    *("kernels", "spectral/prepare", "spectral/verify", *(f"spectral/{name}.py" for name in _MEASURING)),
    *("tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("evidence", "kinds", "pairs", "registrations")),
)
_FOLDS = 5
HELD_OUT = "other pairs"  # that probabilities are fitted to, in place of a pair itself
SET_HELD_OUT = "other sets"
# Pairs of which the table keeps what was measured: where that changes, the fit is out of date
_KIND = "patch"
_NUMBERS = (1, 3, 4)
_SEED = 880_302
_EDGE = 64
# Clues that the table itself has no part in
_MEASURED = ("psr", "view", "surface", "sharpness", "firmness", "overlap", "slide_0", "slide_1", "slide_2", "turn_0")


def create(request: Request) -> Experiment:
    """A job is one draw of a set, as in swath-0003; `quick` is one draw of each set on half the voxels."""
    draws = request.pairs or (1 if request.quick else None)
    counts = _COUNTS if draws is None else dict.fromkeys(_COUNTS, draws)
    settings = as_asked(request, _USUAL | {"counts": counts}, {"edge": 64})

    def run(job: str) -> Outcome:
        name, _, number = job.partition("-")
        recording = Recording(request.opened)
        pairs = draw(name, int(number), settings.seed, settings.edge)
        return Outcome(tuple(row for pair in pairs for row in recording.rows(pair)))

    def write(rows: Sequence[Row]) -> str:
        return _write(rows, request.opened)

    return Experiment("confidence", settings, _in_turns(counts), run, SOURCES, conclude=fitted_and_tested, write=write)


def _in_turns(counts: Mapping[str, int]) -> list[str]:
    """The jobs of all sets, these in turns, so that a run that is stopped has some of each."""
    numbered = [(number / count, f"{name}-{number:04d}") for name, count in counts.items() for number in range(count)]
    return [job for _, job in sorted(numbered)]


def fitted_and_tested(rows: Sequence[Row]) -> list[Row]:
    """How the confidence does on recorded pairs that a fit has not seen; the first row holds the fit to all of them.

    Left out are pairs that no confidence can be right or wrong about: distorted ones, and those that bounds refuse.
    """
    recorded = [each for each in recorded_pairs(rows) if each.cells["set"] != DISTORTED and not each.cells["refused"]]
    slide = fit_slide([pair for pair in recorded if pair.cells["related"]])
    pairs = judged(recorded, slide)
    folds = np.array([int(pair.cells["number"]) % _FOLDS for pair in recorded])
    sets = np.array([pair.cells["set"] for pair in recorded])
    by_set = np.where(sets == UNRELATED, folds, -1 - np.unique(sets, return_inverse=True)[1])
    tested = [*_rows(pairs, _held_out(pairs, folds), HELD_OUT), *_rows(pairs, _held_out(pairs, by_set), SET_HELD_OUT)]
    fitted = json.dumps(_fitted(_fit(pairs), slide))
    return [{**tested[0], "fitted": fitted, "evidence": fingerprint(rows)}, *tested[1:]]


def _write(rows: Sequence[Row], device: Device) -> str:
    """Write the table that the package reads."""
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
    return f"the table is in {TABLE}; it holds from the next start on"


def _fit(pairs: JudgedPairs, some: np.ndarray | slice = slice(None), start: Odds | None = None) -> Odds:
    return fit_odds(pairs.clues[some], pairs.right[some], pairs.share[some], start)


def _held_out(pairs: JudgedPairs, groups: np.ndarray) -> np.ndarray:
    """(N,) probabilities, of each group by a fit to the others."""
    probability, whole = np.zeros(len(groups)), _fit(pairs)
    for group in np.unique(groups):
        inside = groups == group
        fitted = _fit(pairs, ~inside, whole) if (~inside).any() else whole
        probability[inside] = pairs.probability(fitted)[inside]
    return probability


def _fitted(odds: Odds, slide: Slide) -> dict[str, Any]:
    """The parts of the table."""
    probability = {"twin": FITTED["probability"]["twin"]} | odds.to_json()
    return {"probability": probability, "slide": {name: round(value, 4) for name, value in asdict(slide).items()}}


def _rows(pairs: JudgedPairs, probability: np.ndarray, fitted_to: str) -> list[Row]:
    """How probabilities and covariances do, group by group."""
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
    """The clues of some pairs that are measured alone, by the pairs' numbers."""
    found = {}
    for number in _NUMBERS:
        pair = kind_pair(_KIND, number, _SEED)
        registrar = SpectralRegistrar(device, choose_grid((pair.target, pair.source), _EDGE))
        registration = registrar.register(registrar.prepare(pair.target), registrar.prepare(pair.source))
        evidence = dict(registration.evidence)
        found[str(number)] = {name: round(evidence[f"p_{name}"], 3) for name in _MEASURED}
    return found
