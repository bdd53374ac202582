"""Small recordings of every kind, whole: a mounting, three clouds and three poses."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from scipy.spatial.transform import Rotation

from tests.samples.bags.foxglove import point_cloud, written
from tests.samples.bags.messages import (
    CLOUD,
    FIX,
    IMU,
    ODOMETRY,
    PRESSURE,
    STAMP,
    TF,
    cloud,
    fix,
    imu,
    odometry,
    pressure,
    transforms,
)
from tests.samples.bags.writers import Record, write_mcap, write_ros1, write_ros2

# As an operator's file has them [deg, m]
ROLL, PITCH, HEADING, DEPTH = 4.0, -7.0, 72.0, 12.5
R_WORLD_BASE = Rotation.from_euler("ZYX", [90 - HEADING, -PITCH, ROLL], degrees=True)
VARIANCES = np.radians([0.5, 0.75, 3.0]) ** 2
PASCAL = 1025 * 9.80665  # of a meter of sea water
LINK = (0.0, "base_link", "sonar_link", (0.5, -0.25, 1.5), (0.0, 0.0, 0.6, 0.8))


def dive() -> list[Record]:
    """Records at 0, 1 and 2 s."""
    records: list[Record] = [("/tf_static", TF, 0.0, transforms(LINK))]
    for k in range(3):
        records.append(("/points", CLOUD, float(k), cloud(stamp=k + 0.125, rows=5, padding=3)))
        records.append(("/odom", ODOMETRY, float(k), odometry(k, (1.5 * k, 2.25, -0.5), (0.1, 0.2, 0.3, 0.9))))
    return records


def instruments(
    frame: str = "{}", turn: Rotation = R_WORLD_BASE, depth: float = DEPTH, start: float = STAMP
) -> list[Record]:
    """A fix, an orientation and a pressure every quarter of a second, in frames of their own."""
    records: list[Record] = []
    for k in range(17):
        time = start + k / 4
        place = (60.391312 + 1e-6 * k, 5.32212, (0.25, 2.25, 9.0), frame.format("gps"))
        records.append(("/fix", FIX, time, fix(time, *place)))
        records.append(
            ("/imu/data", IMU, time, imu(time, turn.as_quat().tolist(), VARIANCES.tolist(), frame=frame.format("imu")))
        )
        pascal = 101_325 + PASCAL * depth
        records.append(
            ("/pressure", PRESSURE, time, pressure(time, pascal, (0.125 * PASCAL) ** 2, frame.format("pressure")))
        )
    return records


@cache
def navigation(start: float) -> dict[str, tuple[str, bytes]]:
    """Suffix and content of recordings of instruments that begin at a time."""
    with tempfile.TemporaryDirectory() as folder:
        room, records = Path(folder), instruments(start=start)
        files = {
            "bag": write_ros1(room / "a.bag", records),
            "mcap": write_mcap(room / "a.mcap", records, compression=CompressionType.NONE, enable_crcs=False),
            "db3": write_ros2(room / "dive", records) / "dive.db3",
        }
        return {kind: (file.suffix, file.read_bytes()) for kind, file in files.items()}


@cache
def recordings() -> dict[str, tuple[str, bytes]]:
    """Suffix and content of a recording of each kind."""
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        files = {
            "bag": write_ros1(room / "a.bag", dive()),
            "bag bz2": write_ros1(room / "b.bag", dive(), "bz2"),
            "bag lz4": write_ros1(room / "c.bag", dive(), "lz4"),
            "mcap zstd": write_mcap(room / "a.mcap", dive(), chunk_size=900),
            "mcap lz4": write_mcap(room / "b.mcap", dive(), compression=CompressionType.LZ4, enable_crcs=False),
            "mcap plain": write_mcap(room / "c.mcap", dive(), compression=CompressionType.NONE, enable_crcs=False),
            "mcap foxglove": written(room / "d.mcap", *(point_cloud(k) for k in range(3))),
            "db3": write_ros2(room / "dive", dive()) / "dive.db3",
            "db3 by message": write_ros2(room / "packed", dive(), compression="message") / "packed.db3",
        }
        return {kind: (file.suffix, file.read_bytes()) for kind, file in files.items()}
