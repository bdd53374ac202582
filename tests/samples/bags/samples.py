"""Small recordings of every kind, whole: a mounting, three clouds and three poses."""

import tempfile
from functools import cache
from pathlib import Path

from mcap.writer import CompressionType

from tests.samples.bags.foxglove import point_cloud, written
from tests.samples.bags.messages import CLOUD, ODOMETRY, TF, cloud, odometry, transforms
from tests.samples.bags.writers import Record, write_mcap, write_ros1, write_ros2

LINK = (0.0, "base_link", "sonar_link", (0.5, -0.25, 1.5), (0.0, 0.0, 0.6, 0.8))


def dive() -> list[Record]:
    """Records at 0, 1 and 2 s."""
    records: list[Record] = [("/tf_static", TF, 0.0, transforms(LINK))]
    for k in range(3):
        records.append(("/points", CLOUD, float(k), cloud(stamp=k + 0.125, rows=5, padding=3)))
        records.append(("/odom", ODOMETRY, float(k), odometry(k, (1.5 * k, 2.25, -0.5), (0.1, 0.2, 0.3, 0.9))))
    return records


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
