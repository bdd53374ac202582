"""Which points of a scan are used: no returns at the sensor, ranges and boxes; degrees and units that nobody named."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from sonarmap.tools.files.readers.clouds.cloud import Bounds, Cloud
from sonarmap.tools.files.readers.scans import Corrections, PointFrame, read_scans, read_survey
from tests.samples import cloud_files
from tests.samples.bags.messages import CLOUD, cloud
from tests.samples.bags.writers import write_mcap
from tests.samples.cloud_files import TABLE, las, put
from tests.samples.refusals import refuses

RNG = np.random.default_rng(7)
SEEN = RNG.normal((8, 0, 0), 5, (400, 3))


def ring(radius: float, count: int) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, count)
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])


@pytest.mark.parametrize("nothing", [np.zeros((600, 3)), ring(0.025, 600)], ids=["zeros", "a ring at 2.5 cm"])
def test_points_at_the_sensor_are_dropped_and_counted_once(tmp_path: Path, nothing: np.ndarray) -> None:
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", np.vstack([nothing[: 600 - k], SEEN]))
    read = read_scans([tmp_path])
    for scan in read.scans:
        np.testing.assert_array_equal(scan.points, SEEN.astype(np.float32))
    words = "0.npy and 2 more: dropped 1,797 of 2,997 points within 5 cm of the sensor, which are no returns"
    assert read.notes == (words,)
    everything = read_scans([tmp_path / "0.npy"], Corrections(bounds=Bounds.of(0.0, None, []))).scans[0]
    assert len(everything.points) == (1000 if nothing.any() else 400)


def test_zeros_of_a_message_are_no_returns(tmp_path: Path) -> None:
    points = np.zeros((10, 4), np.float32)
    points[:4] = TABLE[:4]
    read = read_scans([write_mcap(tmp_path / "a.mcap", [("/p", CLOUD, 1.0, cloud(points))])])
    assert len(read.scans[0].points) == 4
    assert "dropped 6 of 10 points within 5 cm" in read.notes[0]


def test_ranges_count_from_the_viewpoint_and_boxes_from_the_origin() -> None:
    points = np.array([[1.0, 0, 0], [3, 0, 0], [3, 0, 1], [9, 0, 0], [np.nan, 0, 0]])
    given = Cloud(points, viewpoints=np.tile([3.0, 0, 0], (5, 1)))
    bounds = Bounds.of(0.5, 4.0, ["2.5,1,0.5,3.5,-1,1.5"])
    scan, notes = Corrections(bounds=bounds).scan(given, "a")
    np.testing.assert_array_equal(scan.points, [[1, 0, 0]])
    assert [str(note) for note in notes] == [
        "dropped 1 of 5 points that are NaN or infinite",
        "dropped 1 of 5 points within 50 cm of the sensor, which are no returns",
        "dropped 1 of 5 points beyond 4 m",
        "dropped 1 of 5 points in the excluded box 2.5,1,0.5,3.5,-1,1.5",
    ]


def test_zeros_are_no_returns_from_another_viewpoint() -> None:
    given = Cloud(np.vstack([np.zeros((5, 3)), SEEN]), viewpoints=np.tile([1.0, 2, 3], (405, 1)))
    assert len(Corrections().scan(given, "a")[0].points) == 400


def test_boxes_are_in_meters_forward_left_up() -> None:
    millimeters = Cloud(np.array([[1000.0, 500, 200], [1000, -500, 200]]))  # forward, right, down
    corrections = Corrections(frame=PointFrame("frd", "mm"), bounds=Bounds.of(None, None, [(0.5, -1, -1, 1.5, 0, 0)]))
    np.testing.assert_allclose(corrections.scan(millimeters, "a")[0].points, [[1, 0.5, -0.2]])


def test_impossible_bounds_are_refused(tmp_path: Path) -> None:
    refuses("ranges from 5 to 2 m leave nothing", Bounds.of, 5.0, 2.0, [])
    for box in ("1,2,3", "1,2,3,4,5,x", "1,2,3,4,5,nan", (1.0, 2.0)):
        refuses("--exclude-box .* is no box; wanted x, y, z of two corners", Bounds.of, None, None, [box])
    np.save(tmp_path / "a.npy", np.zeros((5, 3)))
    refuses("dropped 5 of 5 points within 5 cm .*; nothing is left to register", read_scans, [tmp_path / "a.npy"])


def in_degrees(count: int = 400) -> np.ndarray:
    """Longitudes, latitudes and heights of a patch of a bed."""
    return np.column_stack(
        [5.32 + RNG.uniform(0, 0.02, count), 60.39 + RNG.uniform(0, 0.01, count), RNG.uniform(-32, 0, count)]
    )


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2]], ids=["longitude first", "latitude first"])
@pytest.mark.parametrize("suffix", [".xyz", ".pts", ".npy"])
def test_degrees_without_names_are_refused(tmp_path: Path, suffix: str, order: list[int]) -> None:
    path = tmp_path / f"a{suffix}"
    np.save(path, in_degrees()[:, order]) if suffix == ".npy" else np.savetxt(path, in_degrees()[:, order])
    refuses("these look like degrees.*project them to meters.*subtract the sensor's position", read_scans, [path])


@pytest.mark.parametrize("heading", ["lon,lat,height", "Longitude [deg];Latitude [deg];z", "# lat lon h"])
def test_columns_in_degrees_are_refused_by_name(tmp_path: Path, heading: str) -> None:
    separator = next((mark for mark in ",;" if mark in heading), " ")
    rows = "".join(separator.join(map(str, row)) + "\n" for row in in_degrees(3).tolist())
    put(tmp_path / "a.csv", f"{heading}\n{rows}".encode())
    refuses(r"its columns are [lL].*: longitudes and latitudes in degrees", read_scans, [tmp_path / "a.csv"])


@pytest.mark.parametrize("code", [4326, 4979, 4258])
def test_las_in_degrees_is_refused_with_its_system(tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cloud_files, "SCALE", 1e-7)
    crs, table = CRS.from_epsg(code), np.column_stack([in_degrees(), np.ones(400)])
    put(tmp_path / "a.laz", las(table, crs=crs, offset=(5.0, 60.0, 0.0)))
    refuses(rf"its points are in {crs.name}: .*in degrees are not a scan", read_scans, [tmp_path / "a.laz"])


@pytest.mark.parametrize("scale", [2000.0, 200.0])
def test_whole_numbers_are_asked_about(tmp_path: Path, scale: float) -> None:
    np.save(tmp_path / "a.npy", np.round(SEEN * scale).astype(np.int32))
    refuses("whole numbers.*are these millimeters.*--units, such as mm", read_scans, [tmp_path / "a.npy"])
    read = read_survey([tmp_path], corrections=Corrections(frame=PointFrame("flu", "mm")))
    np.testing.assert_allclose(read.scans[0].points, SEEN * scale / 1000, atol=6e-4)
    assert read_survey([tmp_path], corrections=Corrections(frame=PointFrame("flu", "m"))).scans


def test_meters_are_not_asked_about(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SEEN * 50)  # hundreds of meters
    np.save(tmp_path / "b.npy", np.round(SEEN))  # whole meters of a grid
    np.save(tmp_path / "c.npy", SEEN * [0.01, 0.01, 1])  # a pole about the sensor
    assert len(read_scans([tmp_path]).scans) == 3
