"""What the registrations of Table 1 come to, per noise and method, beside what the paper reports."""

from collections import Counter
from dataclasses import asdict, dataclass
from statistics import median
from types import MappingProxyType
from typing import Any

from tools.reproduce.gaussian import GaussianResult, GaussianRow
from tools.reproduce.methods import METHODS
from tools.reproduce.trial import Step
from tools.reproduce.wilson import Rate, wilson

# sigma^2 [m^2] -> the last scan up to which the paper's registrations succeed (Figs. 20, 21)
PAPER_LAST: MappingProxyType[float, int] = MappingProxyType({1.0: 8, 2.0: 6})


@dataclass(frozen=True, slots=True)
class Summary:
    """One noise and one method.

    Attributes:
        sigma2: variance of the range noise at the largest range [m^2].
        method: a key of METHODS.
        paper: the last scan that succeeds in the paper; None for a noise that it does not have.
        last: per seed, the last scan that succeeds, all before it too; -1 where S0 fails.
        right: how many registrations are right.
        right_at_center: how many would be, were the translation taken at the scan's center.
        right_within_3m: how many are also within 3 m, three of the paper's voxels.
        accepted_wrong: how many were believed and are wrong.
        refused_right: how many were not believed and are right.
        wrong_steps: how many are wrong by the first step that is.
        rotation_deg, translation_m: medians over those that are right; None where none is.
        seconds: median of all, the scans being prepared [s].
    """

    sigma2: float
    method: str
    paper: int | None
    last: tuple[int, ...]
    right: Rate
    right_at_center: int
    right_within_3m: int
    accepted_wrong: int
    refused_right: int
    wrong_steps: dict[Step, int]
    rotation_deg: float | None
    translation_m: float | None
    seconds: float

    @property
    def verdict(self) -> str:
        """Whether every seed gets as far as the paper."""
        if self.paper is None:
            return ""
        reached = sum(last >= self.paper for last in self.last)
        if reached == len(self.last):
            return "reached"
        return f"reached by {reached} of {len(self.last)} seeds" if reached else "not reached"

    def to_json(self) -> dict[str, Any]:
        """The same as JSON's types."""
        return asdict(self) | {"verdict": self.verdict}


def summarize(result: GaussianResult) -> list[Summary]:
    """One for each noise and method, in their order."""
    return [
        _summary(sigma2, method, result.of(sigma2, method)) for sigma2 in result.settings.sigma2 for method in METHODS
    ]


def last_right(rows: tuple[GaussianRow, ...]) -> tuple[int, ...]:
    """Per seed, in order, the last scan that is right with all before it; -1 where S0 is wrong."""
    first_wrong = {
        seed: min((row.index for row in rows if row.seed == seed and not row.trial.right), default=None)
        for seed in sorted({row.seed for row in rows})
    }
    farthest = max(row.index for row in rows)
    return tuple(farthest if wrong is None else wrong - 1 for wrong in first_wrong.values())


def _summary(sigma2: float, method: str, rows: tuple[GaussianRow, ...]) -> Summary:
    trials = [row.trial for row in rows]
    right = [trial.error for trial in trials if trial.right]
    wrong = Counter(trial.wrong_step for trial in trials if not trial.right)
    return Summary(
        sigma2=sigma2,
        method=method,
        paper=PAPER_LAST.get(sigma2),
        last=last_right(rows),
        right=wilson(len(right), len(trials)),
        right_at_center=sum(trial.right_at_center for trial in trials),
        right_within_3m=sum(error.translation_m <= 3.0 for error in right),
        accepted_wrong=sum(trial.registration.accepted and not trial.right for trial in trials),
        refused_right=sum(trial.right and not trial.registration.accepted for trial in trials),
        wrong_steps={step: wrong[step] for step in ("yaw", "tilt", "translation")},
        rotation_deg=median(error.rotation_deg for error in right) if right else None,
        translation_m=median(error.translation_m for error in right) if right else None,
        seconds=median(trial.registration.seconds for trial in trials),
    )
