"""Atomic writing of a file, or of several files together, and locks of folders."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from secrets import token_hex

from sonarmap.kernels.errors import InputError

LEFTOVER_PREFIX = ".sonarmap."  # of the names of temporary files
# (temporary path, final path) of the complete files that `all_or_none` will rename
_waiting: ContextVar[list[tuple[Path, Path]] | None] = ContextVar("_waiting", default=None)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to. When the block ends, the file is renamed to `path`; after an error it
    is removed, and an earlier file at `path` is unchanged. The folder is created if it is missing. A full disk, a
    missing permission and the like raise InputError. Inside `all_or_none` the file is renamed when that block ends."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"cannot write {path}: a folder of that name is there. Choose another output folder.")
    temporary, waiting = path.with_name(f"{LEFTOVER_PREFIX}{token_hex(8)}{path.suffix}"), _waiting.get()
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)  # tempfile would restrict the permissions
    try:
        with writing(path):
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            if waiting is None:
                temporary.replace(path)
            else:
                waiting.append((temporary, path))
    finally:
        if (temporary, path) not in (waiting or []):
            discard(temporary)


@contextmanager
def all_or_none() -> Iterator[Sequence[tuple[Path, Path]]]:
    """Rename all files that `atomic_path` writes in the block when it ends; after an error remove all of them.

    Files that belong together are thus never from two runs, even if the disk fills up or the user stops the program. At
    the end of the block only complete files on disk are renamed, one right after the other. A nested block is part of
    the outer one. Yields the growing list of (temporary path, final path) of the files written.
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
    finally:
        _waiting.reset(token)
        for temporary, _ in waiting:
            discard(temporary)


def clear_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders of a run that was killed. The caller must hold the folder's write lock."""
    for path in folder.glob(f"{LEFTOVER_PREFIX}*"):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            discard(path)


def require_writable(folder: Path, make: bool = True) -> None:
    """Raise InputError if a folder cannot be written, before hours of computation. With `make` a missing folder is
    created, otherwise its nearest existing parent is checked."""
    with writing(folder):
        if make:
            folder.mkdir(parents=True, exist_ok=True)
        existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
        tempfile.TemporaryFile(dir=existing).close()


def discard(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError in the block into an InputError that says what to do if `path` cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror or error}; choose another output folder; see 'sonarmap doctor OUT'"
        ) from error


@contextmanager
def locked(folder: Path, writing: bool) -> Iterator[None]:
    """Lock a folder against runs of sonarmap that write to it, or with `writing` also against those that read it. The
    lock ends with the block or the process. A missing folder is not locked, nor one on a file system without locks, as
    some network file systems. With `writing` the temporary files of killed runs are removed."""
    descriptor = _lock(folder, writing)
    try:
        if writing and descriptor is not None:
            clear_leftovers(folder)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(folder: Path, writing: bool) -> int | None:
    """A descriptor of the folder itself, so that no lock file is needed, which holds the lock until it is closed."""
    try:
        from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock

        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except (ImportError, OSError):  # Windows, or a missing folder, which the caller reports
        return None
    try:
        flock(descriptor, (LOCK_EX if writing else LOCK_SH) | LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        others = "writing to it or reading it" if writing else "writing to it"
        raise InputError(
            f"{folder} is in use: another run of sonarmap is {others}. Wait until it has ended, or use another folder"
        ) from error
    except OSError:  # a file system without locks
        pass
    return descriptor
