"""Datagrams from a socket to memory, by a thread that waits neither for the disk nor for the terminal."""

import queue
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.source import overflow_of

MOST_WAITING = 2048  # datagrams in memory, 134 MB at most; half a minute and more of what the sonar sends
_LARGEST = 1 << 16  # bytes; more than UDP allows
_LOOK = 0.1  # seconds between looks whether to end


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
        self._error: OSError | None = None
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
                raise InputError(f"receiving ended: {self._error.strerror}; look at the network") from self._error
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
        self._socket.settimeout(_LOOK)
        try:
            while not self._ends.is_set():
                self._receive()
            self._socket.setblocking(False)
            for _ in range(MOST_WAITING):  # of a stream that does not end there is a last one too
                if not self._receive():
                    break
        except OSError as error:
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
