"""Paths that the system refuses: names too long, and a current folder that is gone."""

from pathlib import Path

import pytest

from tests.samples.clutter_scans import refused_with_reason, scan, sonarmap, write

CALLS = [
    ("register", "PATH.ply", "SCAN"),
    ("map", "PATH", "-o", "OUT"),
    ("map", "FOLDER", "-o", "PATH"),
    *(("map", "FOLDER", "-o", "OUT", option, "PATH") for option in ("--priors", "--odometry", "--ties", "--control")),
    ("live", "PATH", "-o", "OUT"),
    ("record", "-o", "PATH.sonar"),
    ("inspect", "PATH"),
    ("inspect", "SCAN", "--template", "PATH/a.csv"),
    ("view", "PATH"),
    ("export", "PATH", "-o", "OUT", "--format", "laz"),
    ("locate", "PATH", "SCAN"),
    ("section", "PATH", "--from", "0,0", "--to", "1,1", "-o", "OUT"),
    ("volume", "PATH", "--level", "1"),
    ("compare", "PATH", "PATH", "-o", "OUT"),
    ("optimize", "PATH.g2o", "-o", "OUT"),
    ("simulate", "--scene", "pool", "--scans", "2", "-o", "PATH"),
    ("evaluate", "PATH", "PATH"),
    ("--config", "PATH", "devices"),
]


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
@pytest.mark.parametrize("name", ["n" * 300, "gone"], ids=["long", "gone"])
def test_a_path_that_the_system_refuses_is_no_defect(
    tmp_path: Path, call: tuple[str, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scans").mkdir()
    paths = {"SCAN": write(tmp_path / "scans", a=scan(0), b=scan(1))[0], "FOLDER": str(tmp_path / "scans")}
    paths |= {"OUT": str(tmp_path / "out"), "PATH": name}
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    if name == "gone":
        here.rmdir()
    words = [paths.get(word, word.replace("PATH", name)) for word in call]
    refused_with_reason(sonarmap(*words))
