"""Ctrl-C and SIGTERM: a command that is stopped says what became of its work."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does: files are closed, and workers end."""
    if threading.current_thread() is not threading.main_thread():  # only it receives signals
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def when_stopped(words: Callable[[], str]) -> Iterator[None]:
    """Where the block is stopped, `words` says what was kept and how to go on; of nested blocks the inner one does."""
    try:
        yield
    except KeyboardInterrupt as stop:
        if not what_became(stop):
            stop.add_note(words())
        raise


def what_became(stop: KeyboardInterrupt) -> str:
    """What `when_stopped` noted; "" where it noted nothing."""
    return " ".join(getattr(stop, "__notes__", ()))
