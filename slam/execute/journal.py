"""The pairs and scans of a survey that are done, in one file, on disk as soon as each is: what a stopped run goes on
from, and a run with more scans."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kernels.errors import InputError
from slam.execute.attempt import Attempt, from_text
from slam.execute.scan_key import KeyedScan, joined_key
from slam.execute.worker import Done, Signed

_MARK = 0x534F4E52  # SQLite's application_id of our files: "SONR"
_VERSION = 1  # its user_version: of the tables below
_TABLES = (
    """CREATE TABLE pair (
    key TEXT PRIMARY KEY,                -- of the method and both scans' contents
    target TEXT NOT NULL,                -- names of the scans, for people, and for what a failure says
    source TEXT NOT NULL,
    attempt TEXT NOT NULL,               -- JSON, as slam/execute/attempt.py has it
    seconds REAL NOT NULL,               -- that it took
    computed INTEGER NOT NULL DEFAULT 1  -- how many times
)""",
    """CREATE TABLE scan (
    key TEXT PRIMARY KEY,                -- of the method and the scan's content
    name TEXT NOT NULL,
    signature BLOB,                      -- float32, little-endian; NULL where it cannot be prepared
    seconds REAL NOT NULL,
    computed INTEGER NOT NULL DEFAULT 1
)""",
)
_ADD_PAIR = """
INSERT INTO pair (key, target, source, attempt, seconds) VALUES (?, ?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET
target = excluded.target, source = excluded.source, attempt = excluded.attempt, seconds = excluded.seconds,
computed = computed + 1
"""
_ADD_SCAN = """
INSERT INTO scan (key, name, signature, seconds) VALUES (?, ?, ?, ?) ON CONFLICT (key) DO UPDATE SET
name = excluded.name, signature = excluded.signature, seconds = excluded.seconds, computed = computed + 1
"""


@dataclass(frozen=True, slots=True)
class Found:
    """A pair that the journal holds.

    Attributes:
        attempt: what came of it, bit by bit.
        seconds: how long it took when it was computed [s].
    """

    attempt: Attempt
    seconds: float


class Journal:
    """An SQLite database of pairs and scans, each under a key of the method and the contents.

    What `add_pairs` and `add_scans` were given is on disk when they return: a process that is killed at any moment, or
    a machine that loses its power, loses what was not added yet, and nothing else. One process at a time can use it.

    Args:
        path: the file; made where there is none.
        method: a key of all that decides a pair beside its scans.
        fresh: whether to forget what it holds.

    Raises:
        InputError: the file is no journal, is damaged, is in use, or cannot be written; from every call.
    """

    def __init__(self, path: Path, method: str, fresh: bool = False) -> None:
        self.path, self._method = path, method
        with self._telling():
            self._database = sqlite3.connect(path, timeout=0.0, isolation_level=None)
        try:
            with self._telling():
                self._open(fresh)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let others use it."""
        self._database.close()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def count(self) -> int:
        """Number of pairs, of any method."""
        with self._telling():
            return self._database.execute("SELECT count(*) FROM pair").fetchone()[0]

    def pair(self, target: KeyedScan, source: KeyedScan) -> Found | None:
        """A pair that was registered before; None where it was not.

        The names of a pair that failed have to be the same, as they are in what it says.
        """
        with self._telling():
            query = "SELECT target, source, attempt, seconds FROM pair WHERE key = ?"
            row = self._database.execute(query, (self._key(target, source),)).fetchone()
            if row is None:
                return None
            attempt = from_text(row[2])
        if attempt.registration is None and (row[0], row[1]) != (_plain(target.name), _plain(source.name)):
            return None
        return Found(attempt, row[3])

    def signature(self, scan: KeyedScan) -> Signed | None:
        """Of a scan that was signed before; None where it was not."""
        with self._telling():
            query = "SELECT signature, seconds FROM scan WHERE key = ?"
            row = self._database.execute(query, (self._key(scan),)).fetchone()
            if row is None:
                return None
            return Signed(None if row[0] is None else np.frombuffer(row[0], "<f4").astype(np.float32), row[1])

    def add_pairs(self, pairs: Sequence[tuple[KeyedScan, KeyedScan]], done: Sequence[Done]) -> None:
        """Keep pairs, all of them or none."""
        rows = [
            (self._key(target, source), _plain(target.name), _plain(source.name), one.attempt, one.seconds)
            for (target, source), one in zip(pairs, done, strict=True)
        ]
        self._add(_ADD_PAIR, rows)

    def add_scans(self, scans: Sequence[KeyedScan], signed: Sequence[Signed]) -> None:
        """Keep scans' signatures, all of them or none."""
        rows = [
            (self._key(scan), _plain(scan.name), _blob(one.signature), one.seconds)
            for scan, one in zip(scans, signed, strict=True)
        ]
        self._add(_ADD_SCAN, rows)

    def _add(self, statement: str, rows: Sequence[tuple[object, ...]]) -> None:
        with self._telling(), self._whole():
            self._database.executemany(statement, rows)

    def _open(self, fresh: bool) -> None:
        # Exclusive: the lock of the first writing below is held until the end. Full: on disk before a commit returns.
        for pragma in ("locking_mode = EXCLUSIVE", "synchronous = FULL"):
            self._database.execute(f"PRAGMA {pragma}")
        with self._whole():
            self._refuse_others()
            tables = [row[0] for row in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
            if tables and self._pragma("user_version") != _VERSION and not fresh:
                raise InputError(f"{self.path} is of another version of sonarmap; use --fresh to forget what it holds")
            if fresh or not tables:
                for name in tables:
                    self._database.execute(f"DROP TABLE {name}")
                for statement in _TABLES:
                    self._database.execute(statement)
            self._database.execute(f"PRAGMA application_id = {_MARK}")
            self._database.execute(f"PRAGMA user_version = {_VERSION}")

    def _refuse_others(self) -> None:
        """Refuse a file that is not ours to write to, and one that is damaged."""
        empty = self._pragma("page_count") == 0 or not self._database.execute("SELECT * FROM sqlite_master").fetchone()
        if not empty and self._pragma("application_id") != _MARK:
            raise self._unusable("it is another program's database")
        if (fault := self._pragma("quick_check")) != "ok":
            raise self._unusable(str(fault))

    def _pragma(self, name: str) -> object:
        return self._database.execute(f"PRAGMA {name}").fetchone()[0]

    def _key(self, *scans: KeyedScan) -> str:
        return joined_key(self._method, *(scan.key for scan in scans))

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """A transaction."""
        self._database.execute("BEGIN EXCLUSIVE")
        try:
            yield
            self._database.execute("COMMIT")
        except BaseException:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """SQLite's errors, and what cannot be read, in words."""
        try:
            yield
        except InputError:
            raise
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
                raise InputError(
                    f"{self.path} is in use: another run is writing to this folder. Wait for its end, or choose "
                    "another output folder."
                ) from error
            raise InputError(
                f"cannot write {self.path}: {error}. Choose another output folder, or make room and check its "
                "permissions; what the journal holds is kept, and the same command goes on from there."
            ) from error
        except (sqlite3.DatabaseError, ValueError, LookupError, TypeError) as error:
            raise self._unusable(str(error)) from error

    def _unusable(self, why: str) -> InputError:
        return InputError(
            f"{self.path} is no journal of sonarmap, or it is damaged ({why}). Move it away or delete it, and all "
            "pairs are registered anew; or choose another output folder."
        )


def _blob(signature: np.ndarray | None) -> bytes | None:
    return None if signature is None else signature.astype("<f4").tobytes()


def _plain(name: str) -> str:
    """A name as SQLite takes it: file names may hold bytes that are no text."""
    return name.encode("utf-8", "backslashreplace").decode()
