"""`sonarmap simulate`: options without effect are refused; noise is given, described, and taken from a description."""

import json
from pathlib import Path

import pytest

from tests.samples.clutter_scans import done, files_in, refused, sonarmap

ONE = ("--scans", "1", "--quiet", "-o")
SMALL = ("--scene", "harbor", "--scans", "1", "--seed", "9", "--sensor", "paper", "--spacing", "5")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--like description.json --scene harbor --seed 9", ["leave out --scene, --seed"]),
        ("--like description.json --sensor paper", ["leave out --sensor"]),
        ("--like description.json --trajectory survey", ["leave out --trajectory"]),
        ("--trajectory table1 --sensor sonar3d15", ["--sensor has no effect with --trajectory table1", "leave it out"]),
        ("--trajectory table1 --sensor eclipse", ["--sensor has no effect with --trajectory table1", "leave it out"]),
        ("--trajectory table1 --spacing 3", ["--spacing has no effect with --trajectory table1", "leave it out"]),
        ("--scans 1 --quiet --ghosts 1", ["ghosts is"]),
        ("--scans 1 --quiet --speckle -0.5", ["speckle is"]),
        ("--scans 1 --quiet --lobe 9", ["lobe is"]),
        ("--scans 1 --quiet --threshold -1", ["threshold is"]),
    ],
)
def test_what_would_not_be_heeded_or_cannot_be_is_refused(tmp_path: Path, options: str, words: list[str]) -> None:
    refused(sonarmap("simulate", *options.split(), "-o", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_like_gives_the_same_files(tmp_path: Path) -> None:
    assert sonarmap("simulate", *SMALL, "-o", tmp_path / "a", "--quiet").exit_code == 0
    again = done(sonarmap("simulate", "--like", tmp_path / "a" / "description.json", "-o", tmp_path / "b"))
    assert "1 scans of harbor" in again.stdout
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")


def described(folder: Path) -> dict:
    return json.loads((folder / "description.json").read_text())


def test_the_noise_of_the_echoes_is_described_and_given_again(tmp_path: Path) -> None:
    options = ("--ghosts", "0.2", "--speckle", "0.6", "--lobe", "1.5", "--threshold", "0.01")
    assert sonarmap("simulate", "--seed", "4", *options, *ONE, tmp_path / "a").exit_code == 0
    settings = described(tmp_path / "a")["settings"]
    assert (settings["noise"]["ghosts"], settings["noise"]["speckle"], settings["noise"]["lobe"]) == (0.2, 0.6, 1.5)
    assert (settings["sensor"]["name"], settings["sensor"]["threshold"]) == ("eclipse", 0.01)
    again = ("--like", tmp_path / "a" / "description.json", "--quiet", "-o", tmp_path / "b")
    assert sonarmap("simulate", *again).exit_code == 0
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")


def test_a_lower_threshold_leaves_more_points_of_the_same_scan(tmp_path: Path) -> None:
    assert sonarmap("simulate", "--seed", "4", *ONE, tmp_path / "a").exit_code == 0
    like = ("--like", tmp_path / "a" / "description.json")
    assert sonarmap("simulate", *like, "--threshold", "0", *ONE, tmp_path / "b").exit_code == 0
    few, many = (described(tmp_path / name)["scans"][0]["points"] for name in "ab")
    assert 1.2 * few < many < 2 * few


def test_table_1_has_the_papers_noise_alone(tmp_path: Path) -> None:
    assert sonarmap("simulate", "--trajectory", "table1", *ONE, tmp_path / "out").exit_code == 0
    noise = described(tmp_path / "out")["settings"]["noise"]
    assert noise == {"sigma2": 1.0, "outliers": 0.0, "dropouts": 0.0, "ghosts": 0.0, "speckle": 0.0, "lobe": 0.0}
