"""What a kernel must move, by the way it does."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Traffic:
    """Bytes that an algorithm must move, valid elements only, at least once each.

    Attributes:
        reads: of arrays that are only read.
        writes: of arrays that are only written. The lines that a processor fetches before it writes them do not count.
        in_place: of arrays that are changed where they are, reading and writing counted each.
    """

    reads: float = 0
    writes: float = 0
    in_place: float = 0

    @property
    def moved(self) -> int:
        """All of it [bytes]."""
        return round(self.reads + self.writes + self.in_place)
