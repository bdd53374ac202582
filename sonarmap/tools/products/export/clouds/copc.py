# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""COPC 1.0: LAZ 1.4 whose points lie in an octree, so that programs read what they show alone (https://copc.io)."""

import struct
import tempfile
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sonarmap.slam.map.cell import BITS
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.clouds.cloud import Cloud
from sonarmap.tools.products.export.laz import cloud_header, intensity_scale, las_points, meaning

# A node keeps a point in each of so many cells along its edge; the others go to its children, unless they are few.
_CELLS, _FEW, _DEEPEST = 128, 50_000, 12
_INFO, _ENTRY = "<5d2Q2d88x", "<4iQ2i"  # of the specification: sections "info VLR" and "hierarchy VLR"


def write_copc(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write the points that `write_laz` writes; returns what their numbers mean. Their places are in memory, about 130
    bytes for each point with what sorts them, and the rest on disk."""
    header, scale, places = cloud_header(cloud), intensity_scale(cloud), list[np.ndarray]()
    with tempfile.TemporaryFile(prefix="sonarmap.") as file, atomic_path(path) as temporary:
        for portion in cloud.portions():
            points = las_points(portion, header, scale, cloud.timed)
            header.grow(points)
            places.append(np.column_stack([points.array[axis] for axis in "XYZ"]))
            file.write(points.array.tobytes())
        file.flush()
        records = np.memmap(file, header.point_format.dtype(), "r")
        with temporary.open("w+b") as out:
            _write(out, header, np.concatenate(places), records)
    return meaning(cloud, len(records))


def _write(file: BinaryIO, header: Any, places: np.ndarray, records: np.ndarray) -> None:
    """Write the header, a chunk for each node, and where these are; then the header again, which says that too."""
    import laspy
    from laspy.vlrs.known import LasZipVlr
    from laspy.vlrs.vlrlist import VLRList

    lazrs: Any = import_module("lazrs")
    low = places.min(axis=0)
    # `grow` begins at 0
    header.mins, header.maxs = (each * header.scales + header.offsets for each in (low, places.max(axis=0)))
    places -= low
    edge = int(places.max()) + 1
    half = edge * float(header.scales[0]) / 2
    extra = header.point_format.num_extra_bytes
    laz = lazrs.LazVlr.new_for_compression(header.point_format.id, extra, use_variable_size_chunks=True)
    info = laspy.VLR("copc", 1, "COPC info", bytes(struct.calcsize(_INFO)))
    header.vlrs[:0] = [info, LasZipVlr(laz.record_data())]  # the info comes first
    header.are_points_compressed = True
    header.write_to(file)
    compressor = lazrs.LasZipCompressor(file, laz)
    compressor.reserve_offset_to_chunk_table()
    keys: list[tuple[int, int, int, int]] = []
    for key, chosen in _nodes(places, edge):
        if keys:
            compressor.finish_current_chunk()
        compressor.compress_many(np.frombuffer(records[chosen].tobytes(), np.uint8))
        keys.append(key)
    compressor.done()
    end = file.seek(0, 2)
    file.seek(header.offset_to_point_data)
    place, entries = header.offset_to_point_data + 8, b""
    for key, (count, size) in zip(keys, lazrs.read_chunk_table(file, laz), strict=True):
        entries += struct.pack(_ENTRY, *key, place, size, count)
        place += size
    times = records["gps_time"]
    middle = low * header.scales + header.offsets + half
    where = end + 60, len(entries)  # behind the head of the record
    header.vlrs[0].record_data = struct.pack(_INFO, *middle, half, 2 * half / _CELLS, *where, times.min(), times.max())
    header.number_of_evlrs, header.start_of_first_evlr = 1, end
    file.seek(end)
    VLRList([laspy.VLR("copc", 1000, "EPT hierarchy", entries)]).write_to(file, as_extended=True)
    file.seek(0)
    header.write_to(file)


def _nodes(places: np.ndarray, edge: int) -> Iterator[tuple[tuple[int, int, int, int], np.ndarray]]:
    """Depth, x, y and z of every node, and which points (k,) it has, of places (N, 3) int32 from 0 below `edge`."""
    left = np.arange(len(places), dtype=np.int32)
    for depth in range(_DEEPEST + 1):
        node, cell = np.zeros(len(left), np.int64), np.zeros(len(left), np.int64)
        for axis in range(3):
            step = places[left, axis].astype(np.int64) * (_CELLS << depth) // edge
            node, cell = node << BITS | step // _CELLS, cell << BITS | step
        nodes, inverse, size = np.unique(node, return_inverse=True, return_counts=True)
        kept = (size <= _FEW)[inverse] if depth < _DEEPEST else np.ones(len(left), bool)
        kept[np.unique(cell, return_index=True)[1]] = True
        order = np.flatnonzero(kept)[np.argsort(inverse[kept], kind="stable")]
        ends = np.cumsum(np.bincount(inverse[kept], minlength=len(nodes)))
        for key, chosen in zip(nodes.tolist(), np.split(left[order], ends[:-1]), strict=True):
            x, y, z = (key >> BITS * k & (1 << BITS) - 1 for k in (2, 1, 0))
            yield (depth, x, y, z), chosen
        left = left[~kept]
        if not len(left):
            return
