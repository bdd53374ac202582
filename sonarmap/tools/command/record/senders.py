"""Which datagrams are the sonar's: one sonar is recorded, and what others send is counted."""

from dataclasses import dataclass, field

from sonarmap.tools.command.record.receiver import Datagram
from sonarmap.tools.files.readers.clouds.rows import shown
from sonarmap.tools.files.readers.sonar.packets import MAGICS, fault_of

_GONE = 10.0  # seconds without a packet, after which a sonar at another address is taken for the same, restarted
_NAMED = 8  # addresses of other sonars


@dataclass(slots=True)
class Senders:
    """Takes packets of the first sonar that sends, or of the one that was asked for."""

    wanted: str | None = None  # address of the sonar that was asked for, or None
    sonar: str | None = None  # address of the sonar that is recorded; None until it is known
    moves: int = 0  # how often another address took its place
    damaged: int = 0  # packets of the sonar with a wrong length or checksum
    first_damage: str = ""  # what is wrong with the first of them, in words
    foreign: int = 0  # datagrams that are no packets of a sonar
    first_foreign: str = ""  # who sent the first of them and how it begins, in words
    others: int = 0  # whole packets of other sonars, which were left out
    addresses: list[str] = field(default_factory=list)  # of these sonars, as far as there are few
    _latest: float = 0.0

    def is_wanted(self, datagram: Datagram, now: float) -> bool:
        """Whether it is a whole packet of the sonar that is recorded; counted if not. `now` is of a clock that is never
        set [s]."""
        content, sender = datagram.content, datagram.sender
        is_packet = content[:4] in MAGICS
        if not is_packet and sender != self.sonar:
            self.foreign += 1
            self.first_foreign = self.first_foreign or f"from {sender}, beginning with {shown(content[:16])}"
            return False
        fault = fault_of(content) if is_packet else f"begins with {shown(content[:8])}"
        if fault and sender == (self.sonar or self.wanted or sender):
            self.damaged += 1
            self.first_damage = self.first_damage or fault
            return False
        if fault or not self._is_recorded(sender, now):
            self._count_other(sender)
            return False
        self.sonar, self._latest = sender, now
        return True

    def _is_recorded(self, sender: str, now: float) -> bool:
        if self.wanted is not None:
            return sender == self.wanted
        if self.sonar in (None, sender):
            return True
        is_gone = now - self._latest > _GONE
        self.moves += is_gone
        return is_gone

    def _count_other(self, sender: str) -> None:
        self.others += 1
        if sender not in self.addresses and len(self.addresses) < _NAMED:
            self.addresses.append(sender)
