# pyright: strict
"""Scans that have come and wait to be placed."""

from collections import deque
from collections.abc import Iterable
from threading import Condition, Thread

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.incoming import Incoming

_MOST = 256  # scans in memory; the others wait in their file


class Backlog:
    """Takes scans from where they come, by a thread of its own, and holds those that wait.

    Args:
        scans: as they come.

    Attributes:
        error: why no more scans come; None while they may.
        missing: shots that did not come, by their numbers.
        ended: whether all have come.
    """

    def __init__(self, scans: Iterable[Incoming]) -> None:
        self.error: InputError | None = None
        self.missing = 0
        self.ended = False
        self._waiting: deque[Incoming] = deque()
        self._changed = Condition()
        Thread(target=self._run, args=(scans,), name="incoming", daemon=True).start()

    def wait(self, seconds: float, least: int = 1) -> int:
        """How many scans wait: when so many do, all have come, or the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._waiting) >= least or self.ended, seconds)
            return len(self._waiting)

    def __getitem__(self, number: int) -> Incoming:
        with self._changed:
            return self._waiting[number]

    def drop(self, count: int) -> None:
        """Forget the first ones."""
        with self._changed:
            for _ in range(min(count, len(self._waiting))):
                self._waiting.popleft()
            self._changed.notify_all()

    def _run(self, scans: Iterable[Incoming]) -> None:
        try:
            for each in scans:
                with self._changed:
                    self._changed.wait_for(lambda: len(self._waiting) < _MOST)
                    self._waiting.append(each)
                    self.missing = each.missing
                    self._changed.notify_all()
        except BaseException as error:  # noqa: BLE001 - what ends this thread is for who waits for scans
            self.error = error if isinstance(error, InputError) else InputError(f"scans cannot be read: {error!r}")
        finally:
            with self._changed:
                self.ended = True
                self._changed.notify_all()
