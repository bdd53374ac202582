"""The journal keeps its entries, and leaves other files unchanged."""

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.journal import Journal, JournalEntry

ENTRY = JournalEntry("key a", "scan 1 - scan 2", '{"x": 0.1}', 1.25)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


class TestKeeping:
    def test_an_entry_comes_back_in_another_run(self, path: Path) -> None:
        with Journal(path) as journal:
            assert journal.entry("key a") is None
            journal.add([ENTRY])
        with Journal(path) as journal:
            assert (journal.entry("key a"), journal.entry("key b"), journal.count()) == (ENTRY, None, 1)

    def test_entries_added_together_are_kept_all_or_none(self, path: Path) -> None:
        with Journal(path) as journal:
            with pytest.raises(InputError, match="NOT NULL"):
                journal.add([ENTRY, replace(ENTRY, key="b", content=None)])
            assert journal.count() == 0
            journal.add([ENTRY])

    def test_fresh_deletes_and_others_may_use_the_file(self, path: Path) -> None:
        with Journal(path) as journal:
            journal.add([ENTRY])
            with Journal(path, fresh=True) as other:
                assert (journal.count(), other.count()) == (0, 0)
                other.add([ENTRY])
            assert journal.entry("key a") == ENTRY
        # a missing folder is not created
        with pytest.raises(InputError, match=r"cannot write .*journal.sqlite"):
            Journal(path / "below" / "journal.sqlite")


def executed(path: Path, *statements: str) -> None:
    with sqlite3.connect(path) as database:
        for statement in statements:
            database.execute(statement)
    database.close()


def overwritten(path: Path) -> None:
    """Overwrite the middle of a journal with many rows."""
    with Journal(path) as journal:
        for k in range(40):
            journal.add([replace(ENTRY, key=str(k), content="x" * 999)])
    content = bytearray(path.read_bytes())
    content[4096:12288] = b"\x99" * 8192
    path.write_bytes(content)


class TestDamage:
    @pytest.mark.parametrize(
        "change",
        [
            "content = '{\"x\": 0.2}'",
            "seconds = 'long'",
            "checksum = ''",
        ],
    )
    def test_a_changed_entry_is_missing_until_it_is_added_again(self, path: Path, change: str) -> None:
        other = replace(ENTRY, key="key b")
        with Journal(path) as journal:
            journal.add([ENTRY, other])
        executed(path, f"UPDATE entry SET {change} WHERE key = 'key a'")
        with Journal(path) as journal:
            assert (journal.entry("key a"), journal.entry("key b"), journal.damaged) == (None, other, 1)
            journal.add([ENTRY])
            assert (journal.entry("key a"), journal.damaged) == (ENTRY, 1)

    def test_swapped_entries_are_missing(self, path: Path) -> None:
        with Journal(path) as journal:
            journal.add([ENTRY, replace(ENTRY, key="key b", content="other")])
        places = ("key a", "key c"), ("key b", "key a"), ("key c", "key b")
        executed(path, *(f"UPDATE entry SET key = '{new}' WHERE key = '{old}'" for old, new in places))
        with Journal(path) as journal:
            assert [journal.entry(key) for key in ("key a", "key b")] == [None, None]


class TestOtherFiles:
    @pytest.mark.parametrize(
        "make",
        [
            lambda path: executed(path, "CREATE TABLE entry (key TEXT)"),
            overwritten,
            lambda path: path.write_text("my notes, " * 99),
        ],
        ids=["db", "torn", "text"],
    )
    def test_other_files_are_left_unchanged(self, path: Path, make: Callable[[Path], object]) -> None:
        make(path)
        before = path.read_bytes()
        with pytest.raises(InputError, match=r"not a journal of sonarmap, or it is damaged .* delete it"):
            Journal(path, fresh=True)
        assert path.read_bytes() == before

    def test_another_version_is_refused_unless_fresh(self, path: Path) -> None:
        Journal(path).close()
        executed(path, "PRAGMA user_version = 99")
        with pytest.raises(InputError, match="`fresh`"):
            Journal(path)
        with Journal(path, fresh=True) as journal:
            assert journal.count() == 0
