"""A journal of results in one file, on disk as soon as each is added, from which a stopped run continues."""

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock

from sonarmap.kernels.errors import InputError

_APPLICATION_ID = 0x534F4E52  # SQLite's application_id: "SONR"
_VERSION = 3  # SQLite's user_version, of the table below
_TABLE = """CREATE TABLE entry (
    key TEXT PRIMARY KEY,                -- a digest of all that decides the content
    label TEXT NOT NULL,                 -- names of the scans or of the job, for people
    content TEXT NOT NULL,               -- the result as JSON
    seconds REAL NOT NULL,               -- how long it took
    checksum TEXT NOT NULL,              -- of the four above
    computed INTEGER NOT NULL DEFAULT 1  -- how many times
)"""
_ADD = """
INSERT INTO entry (key, label, content, seconds, checksum) VALUES (?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET
label = excluded.label, content = excluded.content, seconds = excluded.seconds, checksum = excluded.checksum,
computed = computed + 1
"""
# SQLite's error codes of a file or folder that cannot be written; other errors come of the file's content.
_UNWRITABLE = (
    sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """The result of one piece of work."""

    key: str  # a digest of all that decides the result
    label: str  # names of what was worked on, for people
    content: str  # the result as text
    seconds: float  # how long it took when it was computed [s]


class Journal:
    """An SQLite database of results, each under a key of its own.

    Entries are on disk when `add` returns: a killed process or a power failure loses only what was not added yet. One
    process at a time can use the file, from any of its threads. An entry with a wrong checksum counts as missing, and
    its work is done again.

    Args:
        path: the file; it is made if it does not exist.
        fresh: whether to delete all entries first.

    Raises:
        InputError: the file is no journal, is damaged, is in use, or cannot be written; from every method.

    Attributes:
        damaged: number of requests for entries with a wrong checksum.
    """

    def __init__(self, path: Path, fresh: bool = False) -> None:
        self.path = path
        self.damaged = 0
        self._lock = RLock()  # threads of this process take turns
        with self._explained_errors():
            self._database = sqlite3.connect(path, timeout=0.0, isolation_level=None, check_same_thread=False)
        self._database.text_factory = _text
        try:
            with self._explained_errors():
                self._open(fresh)
            self._file = _file_at(path)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._database.close()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def count(self) -> int:
        with self._explained_errors():
            return self._database.execute("SELECT count(*) FROM entry").fetchone()[0]

    def entry(self, key: str) -> JournalEntry | None:
        """The entry under this key; None if it is missing or damaged."""
        with self._explained_errors():
            rows = self._database.execute("SELECT label, content, seconds, checksum FROM entry WHERE key = ?", (key,))
            row = rows.fetchone()
        if row is None:
            return None
        entry = JournalEntry(key, *row[:3])
        if _checksum(entry) != row[3]:
            self.damaged += 1
            return None
        return entry

    def add(self, entries: Sequence[JournalEntry]) -> None:
        """Add all entries or none; an entry replaces an earlier one with the same key."""
        self._require_in_place()
        stored = [replace(entry, label=storable(entry.label), seconds=float(entry.seconds)) for entry in entries]
        rows = [(entry.key, entry.label, entry.content, entry.seconds, _checksum(entry)) for entry in stored]
        with self._explained_errors(), self._transaction():
            self._database.executemany(_ADD, rows)

    def unusable(self, reason: str) -> InputError:
        """The error to raise where the file, or the content of an entry, cannot be read."""
        return InputError(
            f"{self.path} is not a journal of sonarmap, or it is damaged ({reason}). Move it away or delete it, and "
            "everything is computed again; or choose another output folder."
        )

    def _require_in_place(self) -> None:
        """Refuse a file that was removed or replaced, as SQLite would go on writing to the one without a name."""
        if self._file is None or _file_at(self.path) != self._file:
            raise InputError(
                f"{self.path} was removed or replaced while this run was using it, so that no more can be kept. "
                "Leave the output folder as it is while it is written to, and run the same command again."
            )

    def _open(self, fresh: bool) -> None:
        # Exclusive: the lock of the first write below is held until the end. Full: on disk before a commit returns.
        for pragma in ("locking_mode = EXCLUSIVE", "synchronous = FULL"):
            self._database.execute(f"PRAGMA {pragma}")
        with self._transaction():
            self._refuse_other_files()
            tables = [row[0] for row in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
            if tables and self._pragma("user_version") != _VERSION and not fresh:
                raise InputError(
                    f"{self.path} is of another version of sonarmap. Move it away or delete it, or use `fresh`, and "
                    "everything is computed again."
                )
            if fresh or not tables:
                for name in tables:
                    self._database.execute(f"DROP TABLE {name}")
                self._database.execute(_TABLE)
            self._database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
            self._database.execute(f"PRAGMA user_version = {_VERSION}")

    def _refuse_other_files(self) -> None:
        """Refuse a file of another program and a damaged one."""
        empty = self._pragma("page_count") == 0 or not self._database.execute("SELECT * FROM sqlite_master").fetchone()
        if not empty and self._pragma("application_id") != _APPLICATION_ID:
            raise self.unusable("it is another program's database")
        if (fault := self._pragma("integrity_check")) != "ok":
            raise self.unusable(" ".join(str(fault).split()))
        table = self._database.execute("SELECT sql FROM sqlite_master WHERE type = 'table'").fetchone()
        if not empty and self._pragma("user_version") == _VERSION and table != (_TABLE,):
            raise self.unusable("its table is another one")

    def _pragma(self, name: str) -> object:
        return self._database.execute(f"PRAGMA {name}").fetchone()[0]

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """All statements of the block take effect, or none."""
        self._database.execute("BEGIN EXCLUSIVE")
        try:
            yield
            self._database.execute("COMMIT")
        except BaseException:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise

    @contextmanager
    def _explained_errors(self) -> Iterator[None]:
        """SQLite's errors as InputErrors that say what to do."""
        try:
            with self._lock:
                yield
        except InputError:
            raise
        except (sqlite3.Error, MemoryError, UnicodeDecodeError) as error:  # a damaged page may raise any
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
            if code == sqlite3.SQLITE_BUSY:
                raise InputError(
                    f"{self.path} is in use: another run is writing to this folder. Wait until it has ended, or choose "
                    "another output folder."
                ) from error
            if code not in _UNWRITABLE:
                raise self.unusable(str(error)) from error
            raise InputError(
                f"cannot write {self.path}: {error}. Choose another output folder, or make room and check its "
                "permissions; what the journal holds is kept, and the same command continues from there. "
                "'sonarmap doctor OUT' looks at a folder OUT and its disk."
            ) from error


def _file_at(path: Path) -> tuple[int, int] | None:
    """Device and inode of the file at this path; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _checksum(entry: JournalEntry) -> str:
    """Checksum of an entry's values and their types: 1 differs from 1.0 and from "1"."""
    parts = (entry.key, entry.label, entry.content, entry.seconds)
    return hashlib.sha256(repr(parts).encode("utf-8", "backslashreplace")).hexdigest()


def _text(stored: bytes) -> str:
    """Text from the file; invalid UTF-8 is replaced, which the checksum detects."""
    return stored.decode("utf-8", "replace")


def storable(label: str) -> str:
    """A label that SQLite can store: file names may hold bytes that are no text."""
    return label.encode("utf-8", "backslashreplace").decode()
