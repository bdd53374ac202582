"""How long a survey took, and what of it was found done: all that differs between runs with the same results."""

from dataclasses import dataclass, field
from time import perf_counter


@dataclass(frozen=True, slots=True)
class PairTime:
    """One pair.

    Attributes:
        target, source: indices of its scans.
        seconds: how long it took when it was computed, with the preparing of scans [s].
        found: whether an earlier run computed it.
    """

    target: int
    source: int
    seconds: float
    found: bool


@dataclass(slots=True)
class Account:
    """What a survey's run took so far.

    Attributes:
        pairs: in the order in which they were done.
        stages: seconds of every stage, by its name.
    """

    pairs: list[PairTime] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    _since: float = field(default_factory=perf_counter)

    @property
    def found(self) -> int:
        """How many pairs an earlier run computed."""
        return sum(pair.found for pair in self.pairs)

    def end_stage(self, name: str) -> None:
        """All since the end of the stage before was of this one, which may have been worked at before."""
        now = perf_counter()
        self.stages[name] = self.stages.get(name, 0.0) + now - self._since
        self._since = now
