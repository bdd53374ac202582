"""Sets of files that appear together."""

from pathlib import Path

import pytest

from tools.writers.atomic import all_or_none, atomic_path


def put(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text)


def test_a_block_inside_another_is_a_part_of_it(tmp_path: Path) -> None:
    with all_or_none() as written:
        put(tmp_path / "a", "1")
        with all_or_none():
            put(tmp_path / "b", "2")
        assert [path.name for _, path in written] == ["a", "b"]
        assert [temporary.read_text() for temporary, _ in written] == ["1", "2"]
        assert not (tmp_path / "a").exists()
        assert not (tmp_path / "b").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def test_what_an_inner_block_wrote_goes_with_the_outer(tmp_path: Path) -> None:
    def stopped() -> None:
        with all_or_none():
            with all_or_none():
                put(tmp_path / "a", "1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert not list(tmp_path.iterdir())
