"""`sonarmap simulate`: options that would go unheard are refused."""

from pathlib import Path

import pytest

from tests.samples.clutter_scans import files_in, refused_with_reason, said, sonarmap

SMALL = ("--scene", "harbor", "--scans", "1", "--seed", "9", "--sensor", "paper", "--spacing", "5")


@pytest.mark.parametrize(
    ("options", "dropped"),
    [
        (["--scene", "harbor", "--seed", "9"], "leave out --scene, --seed"),
        (["--sensor", "paper"], "leave out --sensor"),
        (["--trajectory", "survey"], "leave out --trajectory"),
    ],
)
def test_like_refuses_what_it_would_not_heed(tmp_path: Path, options: list[str], dropped: str) -> None:
    result = sonarmap("simulate", "--like", tmp_path / "description.json", *options, "-o", tmp_path / "out")
    refused_with_reason(result)
    said(result, dropped)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "value"), [("--sensor", "sonar3d15"), ("--sensor", "eclipse"), ("--spacing", "3")])
def test_table_1_refuses_what_it_would_not_heed(tmp_path: Path, name: str, value: str) -> None:
    result = sonarmap("simulate", "--trajectory", "table1", name, value, "-o", tmp_path / "out")
    refused_with_reason(result)
    said(result, f"{name} has no effect with --trajectory table1", "leave it out")


def test_like_gives_the_same_files(tmp_path: Path) -> None:
    assert sonarmap("simulate", *SMALL, "-o", tmp_path / "a", "--quiet").exit_code == 0
    again = sonarmap("simulate", "--like", tmp_path / "a" / "description.json", "-o", tmp_path / "b")
    assert again.exit_code == 0
    assert "1 scans of harbor" in again.stdout
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")
