"""Files that appear whole or not at all, one by one or a set of them together."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from secrets import token_hex

from sonarmap.kernels.errors import InputError

LEFTOVER_PREFIX = ".sonarmap."  # of temporary names
# Of `all_or_none`: temporary files, whole and on disk, and what they will be called.
_waiting: ContextVar[list[tuple[Path, Path]] | None] = ContextVar("_waiting", default=None)
appeared: list[Path] = []  # every file that this program has written so far, whole under its name


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` to write to; renamed to `path` when the block ends well, removed otherwise. The
    folder is made where it is missing. A full disk, a missing permission and the like raise InputError, and whatever
    stood under `path` before stays as it was. Inside `all_or_none` the renaming waits for that block's end."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"cannot write {path}: a folder of that name is there. Choose another output folder.")
    temporary, waiting = path.with_name(f"{LEFTOVER_PREFIX}{token_hex(8)}{path.suffix}"), _waiting.get()
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)  # with the permissions of any new file, which tempfile's have not
    try:
        with writing(path):
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            if waiting is None:
                temporary.replace(path)
                appeared.append(path)
            else:
                waiting.append((temporary, path))
    finally:
        if (temporary, path) not in (waiting or []):
            discard(temporary)


@contextmanager
def all_or_none() -> Iterator[Sequence[tuple[Path, Path]]]:
    """What `atomic_path` writes inside the block appears when it ends well, all of it; nothing otherwise.

    The disk may fill up or the user stop it halfway: results that belong together are never of two runs. Only the
    renaming of files that are already whole on disk, one right after the other, is left for the end. A block inside
    another is a part of it. It gives what has been written so far, growing: the temporary name under which it is whole
    on disk, and its own.
    """
    outer = _waiting.get()
    if outer is not None:
        yield outer
        return
    waiting: list[tuple[Path, Path]] = []
    token = _waiting.set(waiting)
    try:
        yield waiting
        for temporary, path in waiting:
            with writing(path):
                temporary.replace(path)
            appeared.append(path)
    finally:
        _waiting.reset(token)
        for temporary, _ in waiting:
            discard(temporary)


def clear_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders of a run that was killed; only for who has the folder to itself."""
    for path in folder.glob(f"{LEFTOVER_PREFIX}*"):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            discard(path)


def require_writable(folder: Path, make: bool = True) -> None:
    """Refuse a folder that cannot be written before hours are spent on what should go into it; with `make` it is made
    if missing, else the first folder above that is there is looked at."""
    with writing(folder):
        if make:
            folder.mkdir(parents=True, exist_ok=True)
        there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
        tempfile.TemporaryFile(dir=there).close()


def discard(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """An OSError of the block is an InputError that says what to do where a file or a folder cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror or error}. Choose another output folder, or make room and check "
            "its permissions; what was there before is as it was. 'sonarmap doctor OUT' looks at a folder OUT and its "
            "disk."
        ) from error


@contextmanager
def locked(folder: Path, writing: bool) -> Iterator[None]:
    """Keep other runs of sonarmap from a folder, whose files are to be of one run, while the block lasts; with
    `writing` those that read it too. The lock ends with the process at the latest. Nothing is locked where there is no
    such folder, or no such locks, as on some network file systems. Who writes removes what killed runs left there."""
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
