"""Viewpoints per point, from fields of the file."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.clouds.cloud import columns_of
from sonarmap.tools.files.readers.scans import read_scan, read_scans
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.cloud_files import POINTS, STRENGTH, npz, pcd, put
from tests.samples.refusals import refuses

VIEWPOINTS = np.array([[0, 0, 0], [0.5, 0, -1], [1, 2, 3], [4, 5, 6], [-7, 8, 9.5]], np.float32)
SCAN = Scan(POINTS, STRENGTH, name="scan", viewpoints=VIEWPOINTS)
TIMES = np.array([0.0, 1.0, 2.5, 3.0, 4.0])


class TestFields:
    def test_written_viewpoints_are_read_back(self, tmp_path: Path) -> None:
        write_ply(tmp_path / "scan.ply", POINTS, columns_of(SCAN))
        again = read_scan(tmp_path / "scan.ply")
        np.testing.assert_array_equal(again.viewpoints, VIEWPOINTS)
        np.testing.assert_array_equal(again.points, POINTS)
        np.testing.assert_array_equal(again.strength, STRENGTH)

    def test_viewpoints_of_text_and_npz_are_read(self, tmp_path: Path) -> None:
        rows = np.hstack([VIEWPOINTS, POINTS])
        np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="VP_X,vp_y,vp_z,x,y,z", comments="")
        (tmp_path / "b.npz").write_bytes(npz(points=POINTS, viewpoints=VIEWPOINTS.astype(np.float64)))
        for name in ("a.csv", "b.npz"):
            scan = read_scan(tmp_path / name)
            np.testing.assert_array_equal(scan.viewpoints, VIEWPOINTS)
            assert scan.viewpoints is not None
            assert scan.viewpoints.dtype == np.float32

    def test_a_dropped_point_takes_its_viewpoint_along(self, tmp_path: Path) -> None:
        points, viewpoints = POINTS.copy(), VIEWPOINTS.copy()
        points[1, 2] = np.nan
        viewpoints[1, 0] = np.inf
        (tmp_path / "a.npz").write_bytes(npz(points=points, viewpoints=viewpoints))
        np.testing.assert_array_equal(read_scan(tmp_path / "a.npz").viewpoints, np.delete(VIEWPOINTS, 1, axis=0))

    @pytest.mark.parametrize(
        ("arrays", "message"),
        [
            ({"viewpoints": VIEWPOINTS[:4]}, r"viewpoints has shape \(4, 3\); wanted \(5, 3\)"),
            ({"times": TIMES[:, None]}, r"times has shape \(5, 1\); wanted \(5,\)"),
            ({"viewpoints": np.where(VIEWPOINTS == 6, np.nan, VIEWPOINTS)}, "viewpoints of 1 of 5 points are NaN"),
            ({"viewpoints": VIEWPOINTS * 1e5}, "3 of 5 viewpoints lie beyond 100 km"),
        ],
    )
    def test_invalid_viewpoints_are_refused(self, tmp_path: Path, arrays: dict, message: str) -> None:
        (tmp_path / "a.npz").write_bytes(npz(points=POINTS, **arrays))
        refuses(message, read_scan, tmp_path / "a.npz")

    def test_two_coordinates_of_three_are_refused(self, tmp_path: Path) -> None:
        write_ply(tmp_path / "a.ply", POINTS, {"vp_x": TIMES, "vp_z": TIMES})
        refuses("only vp_x and vp_z; give all or none", read_scan, tmp_path / "a.ply")


class TestViewpointOfPcd:
    """PCL's sensor_origin: where the sensor was, in the frame of the points."""

    def put(self, path: Path, line: str, encoding: str = "binary") -> Path:
        return put(path, pcd(encoding).replace(b"VIEWPOINT 0 0 0 1 0 0 0", f"VIEWPOINT {line}".encode()))

    @pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
    def test_the_viewpoint_line_is_the_position_of_the_sensor(self, tmp_path: Path, encoding: str) -> None:
        scan = read_scan(self.put(tmp_path / "a.pcd", "5 -2.5 1e-1 0.6 0 0 0.8", encoding))
        np.testing.assert_array_equal(scan.points, POINTS)
        np.testing.assert_array_equal(scan.viewpoints, np.tile(np.array([5, -2.5, 0.1], np.float32), (5, 1)))

    def test_fields_of_the_points_are_preferred(self, tmp_path: Path) -> None:
        head = (
            f"VERSION 0.7\nFIELDS x y z vp_x vp_y vp_z\nSIZE{' 4' * 6}\nTYPE{' F' * 6}\nWIDTH {len(POINTS)}\nHEIGHT 1\n"
        )
        rows = "\n".join(" ".join(map(str, row)) for row in np.hstack([POINTS, VIEWPOINTS]).tolist())
        read = read_scans([put(tmp_path / "a.pcd", f"{head}VIEWPOINT 5 0 0 1 0 0 0\nDATA ascii\n{rows}\n".encode())])
        np.testing.assert_array_equal(read.scans[0].viewpoints, VIEWPOINTS)
        assert read.notes == ()

    @pytest.mark.parametrize("line", ["0.0 0.0 -0.0 1.0 0 0 0.00", "0 0 0 0.6 0 0 0.8"])
    def test_a_sensor_at_the_origin_needs_no_viewpoints(self, tmp_path: Path, line: str) -> None:
        read = read_scans([self.put(tmp_path / "a.pcd", line)])
        assert (read.scans[0].viewpoints, read.notes) == (None, ())

    @pytest.mark.parametrize("line", ["1 2 3", "1 2 3 1 0 0 x", "1 2 nan 1 0 0 0", "1 2 3 1 0 0 0 0"])
    def test_invalid_viewpoint_lines_are_refused(self, tmp_path: Path, line: str) -> None:
        path = self.put(tmp_path / "a.pcd", line)
        refuses(r"a\.pcd: its PCD header says VIEWPOINT '.*'; wanted a place and a qua", read_scan, path)
