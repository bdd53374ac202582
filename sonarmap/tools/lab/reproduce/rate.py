"""How often something succeeded, and how sure that is after so few trials."""

from dataclasses import dataclass

from scipy.stats import binomtest

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Rate:
    """Successes among trials, with Wilson's 95 % interval (DOI 10.1080/01621459.1927.10502953).

    Attributes:
        successes, trials: 0 <= successes <= trials, at least one trial.
        low, high: the interval of the rate, 0..1.
    """

    successes: int
    trials: int
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.successes}/{self.trials} [{self.low:.2f}..{self.high:.2f}]"


def wilson(successes: int, trials: int) -> Rate:
    """The rate of `successes` among at least one trial, with its interval."""
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    return Rate(successes, trials, float(interval.low), float(interval.high))
