"""Summaries of the registrations of Table 1 by grid, noise and method, next to what the paper reports."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, median_low
from types import MappingProxyType

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.tools.lab.reproduce.gaussian.row import RANKED, GaussianRow
from sonarmap.tools.lab.reproduce.rows import Rate, wilson

# sigma^2 [m^2] -> the last scan up to which the paper's registrations succeed (Figs. 20, 21)
PAPER_LAST: Mapping[float, int] = MappingProxyType({1.0: 8, 2.0: 6})
STEPS = ("yaw", "tilt", "translation")
FEW = HemisphereConfig().yaw_peaks  # as many yaw peaks as "six peaks" follows


@dataclass(frozen=True, slots=True)
class Summary:
    """One grid, one noise and one method.

    Attributes:
        grid: voxels per edge.
        sigma2: variance of the range noise at the largest range [m^2].
        method: a key of VARIANTS.
        paper: the last scan that succeeds in the paper; None for a noise that it does not have.
        last: per seed, the last scan that succeeds, all before it too; -1 where S0 fails.
        right: how many registrations are right.
        right_at_center: how many would be, were the translation taken at the scan's center.
        right_within_3m: how many are also within 3 m, three of the paper's voxels.
        accepted_wrong: how many were accepted and are wrong.
        refused_right: how many were refused and are right.
        yaw_peaks: in how many the right yaw is the highest peak, among the FEW highest, among the RANKED highest.
        wrong_steps: how many are wrong by the first step that is.
        ended_by: how many seeds end (the scan after `last` is wrong) by the first step that is wrong there.
        rotation_deg, translation_m: medians over those that are right; None where none is.
    """

    grid: int
    sigma2: float
    method: str
    paper: int | None
    last: tuple[int, ...]
    right: Rate
    right_at_center: int
    right_within_3m: int
    accepted_wrong: int
    refused_right: int
    yaw_peaks: tuple[int, int, int]
    wrong_steps: Mapping[str, int]
    ended_by: Mapping[str, int]
    rotation_deg: float | None
    translation_m: float | None

    @property
    def median_last(self) -> int:
        """The scan that at least half of the seeds reach."""
        return median_low(self.last)

    @property
    def verdict(self) -> str:
        """Whether every seed gets as far as the paper."""
        if self.paper is None:
            return ""
        reached = sum(last >= self.paper for last in self.last)
        if reached == len(self.last):
            return "reached"
        return f"reached by {reached} of {len(self.last)} seeds" if reached else "not reached"


def summarize(rows: Sequence[GaussianRow]) -> list[Summary]:
    """One for each grid, noise and method, in the order of the rows."""
    cases: dict[tuple[int, float, str], list[GaussianRow]] = {}
    for row in rows:
        cases.setdefault((row.grid, row.sigma2, row.method), []).append(row)
    return [_summary(*case, members) for case, members in cases.items()]


def last_right(rows: Sequence[GaussianRow]) -> tuple[int, ...]:
    """Of one grid, noise and method: per seed, in order, the last scan that is right with all before it; -1 where S0 is
    wrong."""
    farthest = max(row.scan for row in rows)
    ends = dict.fromkeys(sorted({row.seed for row in rows}), farthest)
    for row in rows:
        if not row.right:
            ends[row.seed] = min(ends[row.seed], row.scan - 1)
    return tuple(ends.values())


def among(rows: Sequence[GaussianRow], count: int) -> int:
    """In how many rows the right yaw is among so many highest peaks."""
    return sum(0 < row.yaw_rank <= count for row in rows)


def _summary(grid: int, sigma2: float, method: str, rows: Sequence[GaussianRow]) -> Summary:
    right = [row for row in rows if row.right]
    last = last_right(rows)
    ends = {(seed, end + 1) for seed, end in zip(sorted({row.seed for row in rows}), last, strict=True)}
    return Summary(
        grid=grid,
        sigma2=sigma2,
        method=method,
        paper=PAPER_LAST.get(sigma2),
        last=last,
        right=wilson(len(right), len(rows)),
        right_at_center=sum(row.right_at_center for row in rows),
        right_within_3m=sum(row.translation_m <= 3.0 for row in right),
        accepted_wrong=sum(row.accepted and not row.right for row in rows),
        refused_right=sum(row.right and not row.accepted for row in rows),
        yaw_peaks=(among(rows, 1), among(rows, FEW), among(rows, RANKED)),
        wrong_steps=_count(row for row in rows if not row.right),
        ended_by=_count(row for row in rows if (row.seed, row.scan) in ends),
        rotation_deg=median(row.rotation_deg for row in right) if right else None,
        translation_m=median(row.translation_m for row in right) if right else None,
    )


def _count(rows: Iterable[GaussianRow]) -> dict[str, int]:
    wrong = Counter(row.wrong_step for row in rows)
    return {step: wrong[step] for step in STEPS}
