"""The numbers of a recording's shots: their order where they wrap or start again, and how many are missing."""

from collections.abc import Hashable

REACH = 16  # shots that a packet may come too late

_RANGE = 1 << 32  # sequence_id is a uint32, and begins at 0 again
_MOST_MISSING = 1 << 16  # in a row; more is another count of a sonar that was restarted
_REMEMBERED = 1 << 16


class ShotNumbers:
    """Puts wrapping numbers in one order as they come, and counts.

    A fall by more than half of 2^32 is a wrap, one by a few a packet that came late, any other that the count started
    again, as after a restart of the sonar.

    Attributes:
        late: shots that came after a later one.
        wraps: how often the numbers wrapped.
        restarts: how often they started again.
    """

    def __init__(self) -> None:
        self.late = self.wraps = self.restarts = 0
        self._missing_before = self._count = 0
        self._number = self._place = self._lowest = 0  # of the latest shot, and of the first since the last restart
        self._stamp: float | None = None

    @property
    def missing(self) -> int:
        """How many numbers between the first and the last, since each restart, did not come."""
        return self._missing_before + (self._place - self._lowest + 1 - self._count if self._count else 0)

    def place(self, number: int, stamp: float | None) -> int:
        """Where the shot belongs: ascends in the order in which shots were taken, by 1 if none is missing.

        Args:
            number: of a shot that did not come before, 0 to 2^32 - 1.
            stamp: its time [s], or None.
        """
        step = (number - self._number + _RANGE // 2) % _RANGE - _RANGE // 2
        is_later = stamp is not None and self._stamp is not None and stamp > self._stamp
        if self._count and -REACH <= step < 0 and not is_later:
            self.late += 1
            self._count += 1
            self._lowest = min(self._lowest, self._place + step)
            return self._place + step
        if self._count and 0 < step <= _MOST_MISSING:
            self.wraps += number < self._number
            self._count += 1
            self._place += step
        else:
            self._start_again()
        self._number, self._stamp = number, stamp
        return self._place

    def _start_again(self) -> None:
        self.restarts += self._count > 0
        self._missing_before = self.missing
        self._place += 2 * REACH  # late ones still come before it, and after what was there before
        self._lowest, self._count = self._place, 1


class Remembered:
    """The latest keys of many, to recognize what comes twice."""

    def __init__(self, most: int = _REMEMBERED) -> None:
        self._keys: dict[Hashable, None] = {}
        self._most = most

    def __contains__(self, key: Hashable) -> bool:
        return key in self._keys

    def add(self, key: Hashable) -> None:
        """Remember it, and forget the oldest where there are too many."""
        self._keys[key] = None
        if len(self._keys) > self._most:
            del self._keys[next(iter(self._keys))]
