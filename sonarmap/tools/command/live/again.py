# pyright: strict
"""When what has failed begins again: at once, and later the more often it fails."""

import time
from dataclasses import dataclass, field

_STEADY = 60.0  # what went on for so long has not failed in a row [s]
_LONGEST = 30.0  # pause [s]


@dataclass(slots=True)
class Again:
    """Pauses of 0, 1, 3, 7, 15 and 30 s before something begins again.

    Attributes:
        failures: in a row.
    """

    failures: int = 0
    _begun: float = field(default_factory=time.monotonic)

    def begins(self) -> None:
        """It begins now."""
        self._begun = time.monotonic()

    def pause(self) -> float:
        """It has failed now; how long to wait [s]."""
        self.failures = 1 + self.failures * (time.monotonic() - self._begun < _STEADY)
        return min(_LONGEST, 2.0 ** (self.failures - 1) - 1)


def in_words(pause: float) -> str:
    """As in " in 7 s"; "" for at once."""
    return f" in {pause:.0f} s" if pause else ""
