"""What summary.json says of the files that were read."""

import hashlib
from pathlib import Path

from sonarmap.tools.files.inputs import input_rows


def test_names_start_at_the_folder_that_all_share_and_folders_are_taken_apart(tmp_path: Path) -> None:
    contents = {"dives/a/scan.ply": b"one", "dives/b/scan.ply": b"two", "bag/part.db3": b"three", "nav.csv": b""}
    for name, content in contents.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    paths = [tmp_path / "dives/a/scan.ply", tmp_path / "dives/b/scan.ply", tmp_path / "bag", tmp_path / "nav.csv"]
    assert input_rows([*paths, paths[0]]) == [
        {"name": name, "bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in contents.items()
    ]
    assert [row["name"] for row in input_rows(paths[:1])] == ["scan.ply"]


def test_a_file_that_cannot_be_read_is_listed_all_the_same(tmp_path: Path) -> None:
    assert input_rows([tmp_path / "gone.ply"]) == [{"name": "gone.ply", "bytes": None, "sha256": None}]
    assert input_rows([]) == []
