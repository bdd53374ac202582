"""What the probability and the covariance of a registration are fitted to: pairs of every kind are registered, what
was measured of them is recorded, and the fit is tested on pairs that it has not seen."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.covariance import ELLIPSOID, Slide
from sonarmap.spectral.fitted import FITTED, TABLE
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.judgement import Odds
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.reproduce.confidence_fit import JudgedPairs, fit_odds, fit_slide, judged
from sonarmap.tools.lab.reproduce.evidence import Recording, recorded_pairs
from sonarmap.tools.lab.reproduce.evidence_pairs import DISTORTED, STILL, SURVEY, UNRELATED, draw
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.methods.fingerprint import fingerprint

# Draws of each set: one of a kind is registered five times, one of a survey 35 times. Neither the evaluations nor the
# tests use pairs of this seed. Of the still pairs a sixth has half of `edge` voxels per edge, another twice as many.
_COUNTS = dict.fromkeys(SCAN_KINDS, 300) | {STILL: 1200, UNRELATED: 1200, SURVEY: 240, DISTORTED: 300}
_USUAL = {"counts": _COUNTS, "seed": 880_301, "edge": 128}
# What measures, not what judges: a change of the latter is fitted and tested on what is recorded already.
_MEASURING = ("registration", "grid", "scan", "expected", "prior", "so3", "geometry", "translation")
SOURCES = (
    *("kernels", "spectral/prepare", "spectral/verify", *(f"spectral/{name}.py" for name in _MEASURING)),
    *("tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "evidence", "evidence_pairs", "kinds", "pairs")),
)
_FOLDS = 5
HELD_OUT, SET_HELD_OUT = "other pairs", "other sets"  # what probabilities are fitted to, in place of a pair itself
# Pairs of which the table keeps what was measured alone: where that changes, the fit is out of date
_KIND, _NUMBERS, _SEED, _EDGE = "patch", (1, 3, 4), 880_302, 64
# What is measured alone: the table itself has a part in the others
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
