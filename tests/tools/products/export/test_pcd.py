"""map.pcd in Open3D's two readers, by the format's own words, and in our reader."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.pcd import read_pcd
from sonarmap.tools.files.writers.points import write_pcd

# Asymmetric: near the map's origin, and in coordinates of UTM
PLACES = {"near": (0.0, 0.0, 0.0), "UTM": (431_234.5, 6_651_987.25, -31.5), "an axis": (-12.0, 2_500.0, 7.0)}


def cloud(place: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(5)
    points = rng.uniform([-300, -180, -9], [250, 400, 3], (400, 3)) + PLACES[place]
    return points, {"seen": rng.integers(1, 9, 400).astype(np.int32), "sigma": rng.uniform(0, 1, 400)}


def origin_of(path: Path) -> np.ndarray:
    lines = [line for line in path.read_bytes().split(b"\n")[:12] if line.startswith(b"# origin of x, y, z [m]:")]
    return np.array(lines[0].split()[-3:], float) if lines else np.zeros(3)


@pytest.mark.parametrize("place", PLACES)
def test_opens_in_both_readers_of_open3d_and_in_ours(tmp_path: Path, place: str) -> None:
    import open3d as o3d

    points, columns = cloud(place)
    path = tmp_path / "map.pcd"
    write_pcd(path, points, columns)
    origin = origin_of(path)
    legacy = np.asarray(o3d.io.read_point_cloud(path).points)
    tensor = o3d.t.io.read_point_cloud(path)
    (ours,) = read_pcd(path.read_bytes())
    for opened in (legacy + origin, tensor.point.positions.numpy() + origin, ours.points):
        np.testing.assert_allclose(opened, points, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(tensor.point["seen"].numpy()[:, 0], columns["seen"])
    np.testing.assert_allclose(tensor.point["sigma"].numpy()[:, 0], columns["sigma"], rtol=1e-6)


def test_the_origin_is_round_and_only_of_far_axes(tmp_path: Path) -> None:
    for place, origin in {"near": (0, 0, 0), "UTM": (431_200, 6_652_100, 0), "an axis": (0, 2_600, 0)}.items():
        write_pcd(tmp_path / "map.pcd", *cloud(place))
        np.testing.assert_array_equal(origin_of(tmp_path / "map.pcd"), origin)


def test_coordinates_are_four_bytes_as_the_format_says(tmp_path: Path) -> None:
    """Read by hand: PCD's header, then packed records."""
    points, _ = cloud("near")
    write_pcd(tmp_path / "map.pcd", points)
    head, _, body = (tmp_path / "map.pcd").read_bytes().partition(b"DATA binary\n")
    assert b"SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 400\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 400\n" in head
    np.testing.assert_array_equal(np.frombuffer(body, "<f4").reshape(-1, 3), points.astype(np.float32))


@pytest.mark.parametrize("points", [cloud("UTM")[0].astype(np.float32), np.empty((0, 3))], ids=["float32", "none"])
def test_what_float32_can_hold_is_written_as_it_is(tmp_path: Path, points: np.ndarray) -> None:
    write_pcd(tmp_path / "map.pcd", points)
    (opened,) = read_pcd((tmp_path / "map.pcd").read_bytes())
    np.testing.assert_array_equal(opened.points, points)


@pytest.mark.parametrize("wrong", ["1 2", "1 2 x", "nan 0 0", "1e99 0 0", "", "1 2 3 4"])
def test_an_origin_that_is_none_is_refused(wrong: str) -> None:
    text = f"# .PCD v0.7\n# origin of x, y, z [m]: {wrong}\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
    with pytest.raises(InputError, match="three numbers of meters"):
        read_pcd(f"{text}WIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n".encode())
