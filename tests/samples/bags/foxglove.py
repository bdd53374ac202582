"""foxglove.PointCloud in MCAP, by Foxglove's and the MCAP project's own libraries."""

from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap_protobuf.writer import Writer

from tests.samples.bags.messages import STAMP
from tests.samples.cloud_files import TABLE

TYPES = {"f4": PackedElementField.FLOAT32, "f8": PackedElementField.FLOAT64, "u2": PackedElementField.UINT16}


def point_cloud(number: int = 0, table: np.ndarray = TABLE) -> PointCloud:
    """x, z and intensity as float32, y as float64, and an unused field, with a gap."""
    layout = [("y", "f8", 0), ("ring", "u2", 8), ("x", "f4", 10), ("intensity", "f4", 16), ("z", "f4", 20)]
    records = np.zeros(
        len(table),
        {"names": [n for n, *_ in layout], "formats": [f"<{d}" for _, d, _ in layout],
         "offsets": [o for *_, o in layout], "itemsize": 26},
    )  # fmt: skip
    for column, name in enumerate(("x", "y", "z", "intensity")):
        records[name] = table[:, column]
    message = PointCloud(frame_id="sonar", point_stride=26, data=records.tobytes())
    message.timestamp.FromNanoseconds((STAMP + number) * 10**9 + 250_000_000)
    for name, dtype, offset in layout:
        message.fields.add(name=name, offset=offset, type=TYPES[dtype])
    message.pose.orientation.w = 1
    return message


def written(path: Path, *messages: PointCloud) -> Path:
    """An MCAP file of these messages on /points."""
    with path.open("wb") as file, Writer(file) as writer:
        for k, message in enumerate(messages):
            writer.write_message("/points", message, log_time=k, publish_time=k)
    return path
