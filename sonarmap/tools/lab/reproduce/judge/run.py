"""Judging is fitted to recorded evidence and tested on it, rule by rule."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from sonarmap.spectral.fitted import FITTED, TABLE
from sonarmap.spectral.judge.covariance import ELLIPSOID, Slide
from sonarmap.spectral.judge.odds import Odds
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.lab.reproduce.evidence.settings import DISTORTED
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.judge.fit import CLUES, JudgedPairs, fit_odds, fit_slide, judged
from sonarmap.tools.lab.reproduce.judge.recorded import EVIDENCE, RecordedPair, read_recorded
from sonarmap.tools.lab.reproduce.judge.reference import reference
from sonarmap.tools.lab.reproduce.judge.section import LEFT_OUT, judge_section

_SLIDES, _TURNS = ("slide_0", "slide_1", "slide_2"), ("turn_0", "turn_1")
_NO_SLIDE = Slide(0.0, 0.0, 0.0)
_FOLDS = 5
WHOLE = "all rules"
# What is tried: a rule that is left out, as the clues that go, and whether the covariance is widened
RULES: Mapping[str, tuple[tuple[str, ...], bool]] = MappingProxyType(
    {
        WHOLE: ((), True),
        "without slides among the clues": (_SLIDES, True),
        "without turns": (_TURNS, True),
        "without overlap": (("overlap",), True),
        "without all three": ((*_SLIDES, *_TURNS, "overlap"), True),
        "without openness": (("openness",), True),
        "without rivals": (("rivals",), True),
        "without how far a pose is from no motion": (("moved",), True),
        "without search and what instruments measured": (("search", "measured"), True),
        "without widening by slides": ((), False),
    }
)
_GROUPS: Mapping[str, Callable[[RecordedPair], str]] = MappingProxyType(
    {
        "all": lambda pair: "all pairs",
        "known": lambda pair: str(pair.cells["known"]),
        "set": lambda pair: str(pair.cells["set"]),
        "scene": lambda pair: str(pair.cells["scene"]),
        "edge": lambda pair: str(pair.cells["edge"]),
    }
)


@dataclass(frozen=True, slots=True)
class JudgeSettings:
    """What is judged."""

    evidence: str  # digest of the file
    fitted: str  # digest of the table that is in force
    least: float = SpectralConfig().least_probability  # believed from this probability on


class Judge(Experiment):
    """Fits the judgement to a folder's evidence; a job is a rule that is left out."""

    name = "judge"
    sources: ClassVar[tuple[str, ...]] = ("spectral", "tools/lab/reproduce/judge")
    make_section = staticmethod(judge_section)

    def __init__(self, folder: Path, settings: JudgeSettings, device: Any) -> None:
        """The folder is one of `sonarmap reproduce evidence`."""
        super().__init__(settings, device)
        self._folder = folder
        self._judged = lru_cache(maxsize=1)(self._judge)  # kept for the next rule

    @cached_property
    def _pairs(self) -> list[RecordedPair]:
        """All that a judgement can be right or wrong about: bounds refuse the others."""
        recorded = read_recorded(self._folder)
        return [pair for pair in recorded if pair.cells["set"] != DISTORTED and not pair.cells["refused"]]

    def jobs(self) -> Sequence[str]:
        """The rules."""
        return tuple(RULES)

    def run(self, job: str) -> Outcome:
        """The fit without a rule, and how it does."""
        out, widened = RULES[job]
        slide, pairs = self._judged(widened)
        pairs = replace(pairs, clues=pairs.clues * [name not in out for name in CLUES])
        folds = np.array([int(pair.cells["number"]) % _FOLDS for pair in self._pairs])
        rows = _rows(pairs, _held_out(pairs, folds), job, self.settings.least)
        if job == WHOLE:
            sets = np.array([pair.cells["set"] for pair in self._pairs])
            apart = _held_out(pairs, np.where(sets == "unrelated", folds, -1 - np.unique(sets, return_inverse=True)[1]))
            rows += _rows(pairs, apart, LEFT_OUT, self.settings.least)
            rows[0] = {**rows[0], "fitted": json.dumps(_fitted(_fit(pairs), slide))}
        return Outcome(tuple(rows))

    def _judge(self, widened: bool) -> tuple[Slide, JudgedPairs]:
        slide = fit_slide([pair for pair in self._pairs if pair.cells["related"]]) if widened else _NO_SLIDE
        return slide, judged(self._pairs, slide)

    def write(self, rows: Sequence[Row]) -> str:
        """Write the table that the package reads."""
        fitted = json.loads(str(next(row["fitted"] for row in rows if row.get("fitted"))))
        made = {
            "by": "sonarmap reproduce judge DIR --write",
            "date": datetime.now(UTC).date().isoformat(),
            "pairs": int(rows[0]["pairs"]),
            "evidence": self.settings.evidence,
        }
        table = FITTED | fitted | {"made": made, "reference": reference(self.device)}
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


def _rows(pairs: JudgedPairs, probability: np.ndarray, rule: str, least: float) -> list[Row]:
    """How believed pairs and covariances do, group by group."""
    believed, right, near = probability >= least, pairs.right, pairs.near
    accepted = believed & (pairs.fixed >= FITTED["acceptance"]["fixed"])
    tenth = np.minimum((10 * probability).astype(int), 9)
    rows: list[Row] = []
    for by, value_of in _GROUPS.items():
        values = np.array([value_of(pair) for pair in pairs.pairs])
        for value in np.unique(values).tolist():
            some = values == value
            gaps = [abs((right - probability)[some & (tenth == k)].sum()) for k in range(10)]
            nees = pairs.nees[some & near]
            rows.append(
                {
                    "rule": rule, "by": by, "group": value, "pairs": int(some.sum()),
                    "right": int((some & right).sum()), "believed_right": int((some & right & believed).sum()),
                    "believed_wrong": int((some & ~right & believed).sum()),
                    "accepted_right": int((some & right & accepted).sum()),
                    "accepted_wrong": int((some & ~right & accepted).sum()),
                    "calibration_error": float(sum(gaps) / some.sum()), "near": len(nees),
                    "inside": int((nees <= ELLIPSOID).sum()), "nees": float(nees.mean()) if len(nees) else np.nan,
                    "open": int((pairs.sigma[some & near] > 5).sum()),
                }
            )  # fmt: skip
    return rows


def create(request: Request) -> Judge:
    """The experiment as the command line asks for it."""
    path = request.chosen_folder / EVIDENCE
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    settings = JudgeSettings(digest, hashlib.sha256(TABLE.read_bytes()).hexdigest())
    return Judge(request.chosen_folder, settings, request.opened)
