"""Datagrams from a socket to memory, by a thread that waits for nothing else; and which are the sonar's."""

import queue
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.source import overflow_of
from sonarmap.tools.files.readers.clouds.rows import shown
from sonarmap.tools.files.readers.sonar.packets import MAGICS, fault_of

MOST_WAITING = 2048  # datagrams in memory, 134 MB at most; half a minute and more of what the sonar sends
_LARGEST = 1 << 16  # bytes; more than UDP allows
_PAUSE = 0.1  # seconds after which an end that was asked for is noticed, at the latest
_GONE = 10.0  # seconds without a packet, after which a sonar at another address is taken for the same, restarted
_NAMED = 8  # addresses of other sonars


@dataclass(frozen=True, slots=True)
class Datagram:
    """What came: its bytes, the address of who sent it, and when, by this computer's clock [s, UTC]."""

    content: bytes
    sender: str
    arrival: float


class Receiver:
    """Receives from when it is entered until it is left, and then gives what still waits in the system's buffer.

    Attributes:
        unsaved: datagrams that were left out as too many waited for the disk.
        overflow: datagrams that the system left out as its buffer was full, as far as it says so.
    """

    def __init__(self, listening: socket.socket) -> None:
        self.unsaved = self.overflow = 0
        self._socket = listening
        self._waiting: queue.Queue[Datagram] = queue.Queue(MOST_WAITING)
        self._ends = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="receiver", daemon=True)

    def __enter__(self) -> "Receiver":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def next(self, timeout: float) -> Datagram | None:
        """The next datagram, or None where none came for so long [s].

        Raises InputError: the system does not receive any more.
        """
        try:
            return self._waiting.get(timeout=timeout)
        except queue.Empty:
            if self._error is not None:
                raise InputError(f"receiving ended: {self._error}; look at the network") from self._error
            return None

    def end(self) -> None:
        """Receive nothing that comes from now on."""
        self._ends.set()
        self._thread.join()

    def rest(self) -> Iterator[Datagram]:
        """What has come and was not given yet, after the end."""
        while not self._waiting.empty():
            yield self._waiting.get_nowait()

    def _run(self) -> None:
        self._socket.settimeout(_PAUSE)
        try:
            while not self._ends.is_set():
                self._receive()
            self._socket.setblocking(False)
            for _ in range(MOST_WAITING):  # of a stream that does not end there is a last one too
                if not self._receive():
                    break
        except Exception as error:  # noqa: BLE001 - it is for who asks for datagrams
            self._error = error

    def _receive(self) -> bool:
        """Whether a datagram was there."""
        try:
            content, ancillary, _, (sender, _) = self._socket.recvmsg(_LARGEST, socket.CMSG_SPACE(4))
        except (TimeoutError, BlockingIOError):
            return False
        self.overflow = overflow_of(ancillary) or self.overflow
        try:
            self._waiting.put_nowait(Datagram(content, sender, time.time()))
        except queue.Full:
            self.unsaved += 1
        return True


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
