"""`sonarmap section` and `sonarmap volume` end to end: what they print and write, and their exit codes."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from tests.samples.clutter_scans import done, files_in, printed, refused, sonarmap, table_of
from tests.tools.products.export.finished import finished_map

HERE = Georeference(60.0, 9.0, height=-3.0)
LINE = ("--from", "-4,-1", "--to", "4,2")
KEYS = {"map", "from", "to", "places", "length_m", "width_m", "cell_m", "points", "lowest_m", "highest_m", "heights"}
KEYS |= {"cells", "files"}
VOLUME_KEYS = {"map", "level_m", "to", "heights", "cut_m3", "fill_m3", "net_m3", "cut_sigma_m3", "fill_sigma_m3"}
VOLUME_KEYS |= {"net_sigma_m3", "cell_m", "area_compared_m2", "area_map_only_m2", "area_target_only_m2"}


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map whose place on the Earth is not known."""
    return finished_map(tmp_path_factory.mktemp("maps") / "local")


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map whose place on the Earth is known."""
    return finished_map(tmp_path_factory.mktemp("maps") / "placed", georeference=HERE)


def near(folder: Map, width: float) -> np.ndarray:
    """Points of the map within `width` [m] of LINE, computed with complex numbers."""
    points = folder.parts[0].points
    turned = (points[:, 0] + 1j * points[:, 1] - (-4 - 1j)) / (8 + 3j)
    length = np.hypot(8, 3)
    return points[(turned.real >= 0) & (turned.real <= 1) & (np.abs(turned.imag) * length <= width)]


def test_picture_tables_and_json_match_the_map(local: Path, tmp_path: Path) -> None:
    result = printed(sonarmap("section", local, *LINE, "-o", tmp_path / "new" / "cut.png", "--json"))
    assert result.keys() == KEYS
    folder = read_map_folder(local)
    points = near(folder, 2 * folder.voxel)
    assert result["points"] == len(points) > 20
    assert result["length_m"] == pytest.approx(np.sqrt(73))
    assert (result["lowest_m"], result["highest_m"]) == (points[:, 2].min(), points[:, 2].max())
    assert result["files"] == [str(tmp_path / "new" / name) for name in ("cut.png", "cut.csv", "cut_profile.csv")]
    assert set(files_in(tmp_path / "new")) == {"cut.png", "cut.csv", "cut_profile.csv"}
    rows = table_of(tmp_path / "new" / "cut.csv")
    assert sorted(float(row["height_m"]) for row in rows) == pytest.approx(sorted(points[:, 2]), abs=1e-4)
    assert "easting_m" not in rows[0]
    assert len(table_of(tmp_path / "new" / "cut_profile.csv")) == result["cells"]
    with Image.open(tmp_path / "new" / "cut.png") as picture:
        assert picture.format == "PNG"


def test_a_line_in_map_or_world_coordinates_gives_the_same_section(placed: Path, tmp_path: Path) -> None:
    geodetic = HERE.geodetic(np.array([[-4.0, -1, 0], [4, 2, 0]]))
    projected = Projection.of(HERE).project(geodetic)
    plain = printed(sonarmap("section", placed, *LINE, "-o", tmp_path / "a.csv", "--json"))
    ends = [f"--{name}={x!r},{y!r}" for name, (x, y) in zip(("from", "to"), projected[:, :2].tolist(), strict=True)]
    other = printed(sonarmap("section", placed, *ends, "--world", "-o", tmp_path / "b.csv", "--json"))
    assert (other["points"], other["heights"]) == (plain["points"], plain["heights"])
    assert other["length_m"] == pytest.approx(plain["length_m"], abs=1e-4)
    rows = table_of(tmp_path / "b.csv")
    where = HERE.geodetic(np.array([[float(rows[0]["x_m"]), float(rows[0]["y_m"]), 0]]))
    np.testing.assert_allclose(
        [float(rows[0][name]) for name in ("easting_m", "northing_m")],
        Projection.of(HERE).project(where)[0, :2],
        atol=1e-3,
    )
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--from", "1", "--to", "2,3"), "--from is '1'; wanted two numbers"),
        (("--from", "1,2", "--to", "1,2"), "both 1.00, 2.00"),
        (("--from", "500,2", "--to", "501,2"), "the map lies between"),
        ((*LINE, "--width", "0"), "above 0"),
        ((*LINE, "--world"), "--world needs the place of"),
        ((*LINE, "-o", "cut.jpg"), "ends in .png"),
    ],
)
def test_invalid_lines_are_refused(
    local: Path, options: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(sonarmap("section", local, "-o", "cut.png", *options), words)
    assert not list(tmp_path.iterdir())


def test_folders_that_are_not_maps_are_refused(local: Path, tmp_path: Path) -> None:
    refused(sonarmap("section", tmp_path / "none", *LINE, "-o", tmp_path / "a.png"), "is not a folder")
    refused(sonarmap("section", local, *LINE, "-o", local / "a.png"), "the map's folder")
    refused(sonarmap("volume", tmp_path, "--level", "1"), "summary.json")


def test_the_volume_to_a_level(local: Path, placed: Path) -> None:
    result = printed(sonarmap("volume", local, "--level", "-1", "--cell", "2", "--height", "top", "--json"))
    assert result.keys() == VOLUME_KEYS
    points = read_map_folder(local).parts[0].points
    assert result["area_compared_m2"] == 4 * len(np.unique(points[:, :2] // 2, axis=0))
    assert 0 < result["fill_m3"] < result["area_compared_m2"] * (-1 - points[:, 2].min())
    assert result["net_m3"] == pytest.approx(result["fill_m3"] - result["cut_m3"])
    lower = printed(
        sonarmap("volume", placed, "--level=-4", "--cell", "2", "--height", "top", "--json")
    )  # its origin is 3 m down
    assert lower["net_m3"] == pytest.approx(result["net_m3"])
    assert "water's surface" in lower["heights"]


def test_the_volume_between_two_maps(local: Path, placed: Path) -> None:
    result = printed(sonarmap("volume", placed, placed, "--json"))
    assert (result["cut_m3"], result["fill_m3"], result["area_map_only_m2"]) == (0, 0, 0)
    assert result["net_sigma_m3"] > 0
    assert printed(sonarmap("volume", local, placed, "--same-frame", "--json"))["net_m3"] == 0
    result = done(sonarmap("volume", local, placed, "--same-frame"))
    assert "cut (lost)" in result.stdout
    assert "these were not compared" in result.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "neither of --level and OTHER given"),
        (("--level", "1", "other"), "both of --level and OTHER given"),
        (("--level", "nan"), "--level is nan"),
        (("--level", "1", "--cell", "0"), "above 0"),
        (("--level", "1", "--min-seen", "99"), "give a smaller --min-seen"),
    ],
)
def test_invalid_volume_options_are_refused(local: Path, options: tuple[str, ...], words: str) -> None:
    refused(sonarmap("volume", local, *options), words)


def test_maps_without_a_common_frame_are_refused(local: Path, placed: Path) -> None:
    refused(sonarmap("volume", local, placed), "--same-frame")
