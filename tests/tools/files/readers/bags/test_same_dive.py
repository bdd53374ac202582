"""The same dive as PLY, LAZ, ROS 1 and 2 bags and MCAP, written by independent libraries: the same scans."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.bags.messages import CLOUD, STAMP, cloud
from tests.samples.bags.writers import WRITERS
from tests.samples.cloud_files import SCALE, las

GPS_OF_STAMP = STAMP - 315_964_800 + 18 - 1_000_000_000  # adjusted standard GPS time of the first scan


@pytest.fixture(scope="module")
def tables() -> list[np.ndarray]:
    """(N, 4) float32 of each scan: points, and strengths that are integers as those of LAS are."""
    rng = np.random.default_rng(7)
    counts = (3000, 1700, 2451)
    return [np.hstack([rng.normal(1, 9, (n, 3)), rng.integers(1, 60_000, (n, 1))]).astype(np.float32) for n in counts]


def write_ply(path: Path, table: np.ndarray) -> None:
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    points = o3d.t.geometry.PointCloud(tensor(np.ascontiguousarray(table[:, :3])))
    points.point["intensity"] = tensor(np.ascontiguousarray(table[:, 3:]))
    assert o3d.t.io.write_point_cloud(path, points)


def stamp_of(k: int) -> float:
    return STAMP + 0.25 * k


@pytest.mark.parametrize("kind", [*WRITERS, "ply", "las", "laz"])
def test_every_format_gives_the_same_scans(tmp_path: Path, tables: list[np.ndarray], kind: str) -> None:
    path = tmp_path
    for k, table in enumerate(tables):
        if kind == "ply":
            write_ply(tmp_path / f"dive{k}.ply", table)
        elif kind in ("las", "laz"):
            times = np.full(len(table), GPS_OF_STAMP + 0.25 * k)
            (tmp_path / f"dive{k}.{kind}").write_bytes(las(table, compressed=kind == "laz", gps=times))
    if kind in WRITERS:
        records = [("/points", CLOUD, stamp_of(k), cloud(table, stamp_of(k))) for k, table in enumerate(tables)]
        path = WRITERS[kind](tmp_path, records)
    read = read_scans([path])
    assert len(read.scans) == len(tables)
    assert [scan.stamp for scan in read.scans] == [float(k) if kind == "ply" else stamp_of(k) for k in range(3)]
    for scan, table in zip(read.scans, tables, strict=True):
        tolerance = SCALE / 2 + 1e-6 if kind in ("las", "laz") else 0.0
        np.testing.assert_allclose(scan.points, table[:, :3], rtol=0, atol=tolerance)
        np.testing.assert_array_equal(scan.strength, table[:, 3])
        assert scan.points.dtype == np.float32
