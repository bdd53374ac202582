"""Who may use a folder now: one program that writes to it, or several that read it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.writers.atomic import clear_leftovers


@contextmanager
def locked(folder: Path, writing: bool) -> Iterator[None]:
    """Keep other runs of sonarmap from a folder, whose files are to be of one run, while the block lasts; with
    `writing` those that read it too. The lock ends with the process at the latest. Nothing is locked where there is no
    such folder, or no such locks, as on some network file systems. Who writes removes what killed runs left there.
    Raises InputError: another run has the folder."""
    descriptor = _lock(folder, writing)
    try:
        if writing and descriptor is not None:
            clear_leftovers(folder)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(folder: Path, writing: bool) -> int | None:
    """A descriptor that holds the lock until it is closed. Of the folder itself: no file is left behind."""
    try:
        from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock

        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except (ImportError, OSError):  # Windows; and whoever reads a missing folder says so
        return None
    try:
        flock(descriptor, (LOCK_EX if writing else LOCK_SH) | LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        others = "writing to it or reading it" if writing else "writing to it"
        raise InputError(
            f"{folder} is in use: another run of sonarmap is {others}. Wait until it has ended, and run the same "
            "command again; or use another folder"
        ) from error
    except OSError:  # no such locks here
        pass
    return descriptor
