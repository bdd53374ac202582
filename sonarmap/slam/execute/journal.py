"""A journal of results in one file, on disk as soon as each is added, from which a stopped run continues."""

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path

from sonarmap.kernels.errors import InputError

_APPLICATION_ID = 0x534F4E52  # SQLite's application_id: "SONR"
_VERSION = 3  # SQLite's user_version, of the table below
_TABLE = """CREATE TABLE IF NOT EXISTS entry (
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
_WAIT = 60.0  # for others that use the file [s]
# SQLite's error codes of a file or folder that cannot be written; other errors come of the file's content.
_UNWRITABLE = (
    sqlite3.SQLITE_BUSY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_READONLY,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """The result of one piece of work."""

    key: str  # a digest of all that decides the result
    label: str  # names of what was worked on, for people; text without surrogates
    content: str  # the result as text
    seconds: float  # how long it took when it was computed [s]


class Journal:
    """An SQLite database of results, each under a key of its own.

    Entries are on disk when `add` returns: a killed process or a power failure loses only what was not added yet. An
    entry with a wrong checksum counts as missing, and its work is done again.

    Args:
        path: the file; it is made if it does not exist.
        fresh: whether to delete all entries first.

    Raises:
        InputError: the file is no journal, is damaged, or cannot be written; from every method.

    Attributes:
        damaged: number of requests for entries with a wrong checksum.
    """

    def __init__(self, path: Path, fresh: bool = False) -> None:
        self.path = path
        self.damaged = 0
        with self._explained_errors():
            self._database = sqlite3.connect(path, timeout=_WAIT, check_same_thread=False)
        # invalid UTF-8 is replaced, which the checksum detects
        self._database.text_factory = lambda stored: stored.decode("utf-8", "replace")
        try:
            with self._explained_errors():
                self._open(fresh)
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
        rows = [(*astuple(entry), _checksum(entry)) for entry in entries]
        with self._explained_errors(), self._database:
            self._database.executemany(_ADD, rows)

    def unusable(self, reason: str) -> InputError:
        """The error to raise where the file, or the content of an entry, cannot be read."""
        return InputError(
            f"{self.path} is not a journal of sonarmap, or it is damaged ({reason}). Move it away or delete it, and "
            "everything is computed again; or choose another output folder."
        )

    def _open(self, fresh: bool) -> None:
        """Make the table, or refuse the file before anything is written to it."""
        self._database.execute("PRAGMA synchronous = FULL")  # on disk before a commit returns
        tables = [row[0] for row in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        if tables and self._pragma("application_id") != _APPLICATION_ID:
            raise self.unusable("it is another program's database")
        if (fault := self._pragma("integrity_check")) != "ok":
            raise self.unusable(" ".join(str(fault).split()))
        if tables and self._pragma("user_version") != _VERSION and not fresh:
            raise InputError(
                f"{self.path} is of another version of sonarmap. Move it away or delete it, or use `fresh`, and "
                "everything is computed again."
            )
        for name in tables if fresh else ():
            self._database.execute(f"DROP TABLE {name}")
        self._database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        self._database.execute(f"PRAGMA user_version = {_VERSION}")
        self._database.execute(_TABLE)

    def _pragma(self, name: str) -> object:
        return self._database.execute(f"PRAGMA {name}").fetchone()[0]

    @contextmanager
    def _explained_errors(self) -> Iterator[None]:
        """SQLite's errors as InputErrors that say what to do."""
        try:
            yield
        except (sqlite3.Error, MemoryError, UnicodeDecodeError) as error:  # a damaged page may raise any
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
            if code == sqlite3.SQLITE_READONLY_DBMOVED:
                raise InputError(
                    f"{self.path} was removed or replaced while this run was using it, so that no more can be kept. "
                    "Leave the output folder as it is while it is written to, and run the same command again."
                ) from error
            if code & 0xFF not in _UNWRITABLE:
                raise self.unusable(str(error)) from error
            raise InputError(
                f"cannot write {self.path}: {error}. Choose another output folder, or make room and check its "
                "permissions; what the journal holds is kept, and the same command continues from there. "
                "'sonarmap doctor OUT' looks at a folder OUT and its disk."
            ) from error


def _checksum(entry: JournalEntry) -> str:
    """Checksum of an entry's values and their types: 1 differs from 1.0 and from "1"."""
    return hashlib.sha256(repr(astuple(entry)).encode("utf-8", "backslashreplace")).hexdigest()
