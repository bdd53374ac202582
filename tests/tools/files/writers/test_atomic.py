"""Sets of files that appear together."""

import os
from pathlib import Path

import pytest

from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path, clear_leftovers


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
    with pytest.raises(KeyboardInterrupt), all_or_none():  # noqa: PT012
        with all_or_none():
            put(tmp_path / "a", "1")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_have_the_permissions_of_any_new_file_and_the_process_keeps_its_mask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mask: int
) -> None:
    """A moment without a mask is one in which another thread's files are everybody's."""
    set_mask, before = os.umask, os.umask(mask)
    try:
        monkeypatch.setattr(os, "umask", lambda _: pytest.fail("the mask is all threads'"))
        put(tmp_path / "a", "1")
        assert (tmp_path / "a").stat().st_mode & 0o777 == 0o666 & ~mask
    finally:
        set_mask(before)


def test_leftovers_are_removed_and_what_a_link_among_them_leads_to_is_kept(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    (out / ".sonarmap.scans.x1").mkdir(parents=True)
    (out / ".sonarmap.scans.x1" / "0.npz").write_text("")
    (out / ".sonarmap.1.ply").write_text("half")
    elsewhere.mkdir()
    put(elsewhere / "mine", "1")
    (out / ".sonarmap.scans").symlink_to(elsewhere)
    clear_leftovers(out)
    assert not list(out.iterdir())
    assert (elsewhere / "mine").read_text() == "1"
