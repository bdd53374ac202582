"""`sonarmap locate` end to end: what it prints and writes, and its exit codes; and `sonarmap.locate`."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import sonarmap as library
from sonarmap.tools.files.readers.trajectory import read_tum
from tests.samples.clutter_scans import (
    T_WORLD_SENSOR,
    done,
    plane,
    printed,
    printed_at,
    refused,
    said,
    scan,
    sonarmap,
    write,
)

GRID = ("--grid", "64")
ORIGIN = ("--origin", "60.3913,5.3221,-3")
KEYS = {"name", "stamp", "located", "T_map_scan", "covariance", "sigmas", "probability", "psr", "overlap", "world"}
KEYS |= {"alternatives", "tracked", "seconds", "reason"}


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of three of the four scans; its frame is the first one's."""
    folder = tmp_path_factory.mktemp("mapped")
    write(folder / "scans", a=scan(0), b=scan(1), c=scan(2))
    done(sonarmap("map", folder / "scans", "-o", folder / "map", *GRID, "--no-report", "--quiet"))
    return folder / "map"


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Scans of the place, of another place, and of a plane."""
    return write(tmp_path_factory.mktemp("scans"), a_here=scan(3), b_other=scan(3, scene=2), c_flat=plane())


@pytest.fixture(scope="module")
def outcome(mapped: Path, scans: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """The printed JSON and the path of the track."""
    track = tmp_path_factory.mktemp("out") / "track.tum"
    return printed(sonarmap("locate", mapped, *scans, *GRID, *ORIGIN, "-o", track, "--alone", "--json")), track


def check_pose(T: Any) -> None:
    error = T_WORLD_SENSOR[3].inv() * RigidTransform.from_matrix(np.array(T))
    assert np.linalg.norm(error.translation) < 0.3
    assert error.rotation.magnitude() < np.radians(1.5)


def test_json_of_one_located_and_two_refused_scans(outcome: tuple[dict[str, Any], Path]) -> None:
    result, _ = outcome
    assert result.keys() == {"scans", "map", "grid", "voxel", "located", "written"}
    assert (result["grid"], result["located"]) == (64, 1)
    here, other, flat = result["scans"]
    assert here.keys() == other.keys() == flat.keys() == KEYS
    assert [(row["name"], row["located"]) for row in result["scans"]] == [
        ("a_here", True),
        ("b_other", False),
        ("c_flat", False),
    ]
    check_pose(here["T_map_scan"])
    assert here["probability"] > 0.9
    assert here["psr"] > 10
    covariance = np.array(here["covariance"])
    assert np.linalg.eigvalsh(covariance).min() > 0
    np.testing.assert_allclose(np.array(here["sigmas"]) ** 2, covariance.diagonal())
    assert other["probability"] < 0.5
    assert other["world"] is None
    assert (flat["T_map_scan"], flat["covariance"], flat["psr"], flat["probability"]) == (None, None, None, 0)
    assert "plane" in flat["reason"]


def test_the_position_on_the_earth(outcome: tuple[dict[str, Any], Path]) -> None:
    here = outcome[0]["scans"][0]
    world, (x, y, z) = here["world"], np.array(here["T_map_scan"])[:3, 3]
    assert world["height"] == pytest.approx(z - 3)
    assert (world["latitude"] - 60.3913) * 111_415 == pytest.approx(y, abs=0.02)  # [m] in a degree there
    assert (world["longitude"] - 5.3221) * 55_150 == pytest.approx(x, abs=0.02)
    assert (world["crs"], world["vertical"]) == ("EPSG:32632", "surface")
    assert 200_000 < world["easting"] < 800_000


def test_the_track_contains_only_located_scans(outcome: tuple[dict[str, Any], Path]) -> None:
    result, path = outcome
    assert result["written"] == str(path)
    track = read_tum(path)
    assert track.stamps.tolist() == [result["scans"][0]["stamp"]]
    np.testing.assert_allclose(track.T_world_sensor[0].as_matrix(), result["scans"][0]["T_map_scan"], atol=1e-9)


def test_a_scan_of_another_place_ends_with_3_and_writes_nothing(mapped: Path, scans: list[str], tmp_path: Path) -> None:
    result = sonarmap("locate", mapped, scans[1], *GRID, "-o", tmp_path / "track.tum")
    assert result.exit_code == 3
    assert "0 of 1 scan was located" in result.stdout
    assert "because: " in result.stdout
    said(result, "track.tum is not written")
    assert not list(tmp_path.iterdir())


def test_the_table_fits_a_narrow_terminal(mapped: Path, scans: list[str]) -> None:
    lines = printed_at(80, "locate", mapped, scans[0], *GRID, *ORIGIN)
    assert max(map(len, lines[:-1])) <= 80  # the last line is the reason
    assert any("60.39" in line for line in lines)


def test_locate_from_python(mapped: Path, scans: list[str]) -> None:
    here, other = library.locate(mapped, [scans[0], scan(3, scene=2)], edge=64)
    assert isinstance(here, library.Located)
    assert (here.located, other.located) == (True, False)
    check_pose(here.T_map_scan.as_matrix())
    assert [len(str(each).splitlines()) <= 3 for each in (here, other)] == [True, True]
    with pytest.raises(library.InputError, match="wanted Map or str or PathLike"):
        library.locate(scan(0), [scans[0]])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-o", "track.csv"), "ends in .tum"),
        (("--priors", "nav.csv"), "was not measured by instruments"),
        (("--crs", "EPSG:32632"), "a map whose place is not known"),
    ],
)
def test_invalid_options_are_refused(mapped: Path, scans: list[str], options: tuple[str, ...], words: str) -> None:
    refused(sonarmap("locate", mapped, scans[0], *GRID, *options), words)
