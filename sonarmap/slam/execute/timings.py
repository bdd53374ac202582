"""How long a survey took, and which of its pairs came from the journal: all that may differ between equal runs."""

from dataclasses import dataclass, field
from time import perf_counter


@dataclass(frozen=True, slots=True)
class PairTime:
    """How long one pair took.

    Attributes:
        target, source: indices of its scans among all of the survey.
        seconds: how long it took when it was computed, with the preparing of its scans [s].
        from_journal: whether an earlier run computed it.
    """

    target: int
    source: int
    seconds: float
    from_journal: bool


@dataclass(slots=True)
class Timings:
    """How long a survey's run took so far.

    Attributes:
        pairs: in the order in which they were done.
        stages: seconds of every stage, by its name.
    """

    pairs: list[PairTime] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    _stage_start: float = field(default_factory=perf_counter)

    @property
    def from_journal(self) -> int:
        """How many pairs an earlier run computed."""
        return sum(pair.from_journal for pair in self.pairs)

    def end_stage(self, name: str) -> None:
        """Count the time since the end of the stage before to this stage; a stage may come up several times."""
        now = perf_counter()
        self.stages[name] = self.stages.get(name, 0.0) + now - self._stage_start
        self._stage_start = now
