"""Small valid files of every format, made by hand so that the tests know every byte; LAS and LAZ by laspy."""

import io
import struct
from collections.abc import Sequence
from pathlib import Path

import laspy
import lzf
import numpy as np
from laspy.header import GpsTimeType
from wlsonar import range_image_protocol as rip

from tests.samples.recordings import range_image, strength_image

# x, y, z, strength; all numbers different and exact in float32, one line of text each
TABLE = np.array(
    [
        [1.5, -2.25, 0.75, 30.5],
        [2.5, 3.25, -0.5, 41.0],
        [10.125, -7.5, 4.0, 52.25],
        [6.75, 0.125, -3.5, 63.0],
        [12.5, 8.25, 1.25, 74.5],
    ],
    np.float32,
)
POINTS, STRENGTH = TABLE[:, :3], TABLE[:, 3]


def ply(encoding: str = "binary_little_endian", names: Sequence[str] = ("x", "y", "z", "intensity"), faces=False):
    """TABLE as PLY: a short and a double among the properties, and optionally faces after the vertices."""
    order = ">" if "big" in encoding else "<"
    fields = [(names[0], "f4"), ("ring", "i2"), (names[1], "f8"), (names[2], "f4"), (names[3], "f4")]
    kinds = {"f4": "float", "f8": "double", "i2": "short"}
    header = ["ply", f"format {encoding} 1.0", "comment made by hand", f"element vertex {len(TABLE)}"]
    header += [f"property {kinds[kind]} {name}" for name, kind in fields]
    if faces:
        header += ["element face 2", "property list uchar int vertex_indices", "property uchar label"]
    text = "\n".join([*header, "end_header", ""]).encode()
    if encoding == "ascii":
        rows = [" ".join(map(str, [x, 7, y, z, s])) for x, y, z, s in TABLE.tolist()]
        rows += ["3 0 1 2 9", "4 1 2 3 4 8"] if faces else []
        return text + "\n".join([*rows, ""]).encode()
    records = np.zeros(len(TABLE), [(name, order + kind) for name, kind in fields])
    for column, name in enumerate(names):
        records[name] = TABLE[:, column]
    indices = struct.pack(order + "B3iB", 3, 0, 1, 2, 9) + struct.pack(order + "B4iB", 4, 1, 2, 3, 4, 8)
    return text + records.tobytes() + (indices if faces else b"")


def pcd(encoding: str) -> bytes:
    """TABLE as PCD, with an unused field of three values in front."""
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS normal x y z intensity\n"
        f"SIZE 2 4 8 4 4\nTYPE I F F F F\nCOUNT 3 1 1 1 1\nWIDTH {len(TABLE)}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(TABLE)}\nDATA {encoding}\n"
    ).encode()
    if encoding == "ascii":
        return header + "".join(f"1 2 3 {x} {y} {z} {s}\n" for x, y, z, s in TABLE.tolist()).encode()
    kinds = [("normal", "<i2", 3), ("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("intensity", "<f4")]
    records = np.zeros(len(TABLE), np.dtype(kinds))
    for column, name in enumerate(["x", "y", "z", "intensity"]):
        records[name] = TABLE[:, column]
    if encoding == "binary":
        return header + records.tobytes()
    plain = b"".join(np.ascontiguousarray(records[kind[0]]).tobytes() for kind in kinds)
    packed = lzf.compress(plain, 2 * len(plain))
    return header + struct.pack("<II", len(packed), len(plain)) + packed


def text(separator: str = " ", header: str = "", columns: Sequence[int] = (0, 1, 2, 3), end: str = "\n") -> bytes:
    rows = [separator.join(str(row[column]) for column in columns) for row in TABLE.tolist()]
    return (header + end.join([*rows, ""])).encode()


def colored() -> bytes:
    """TABLE with a color in each line, as scanners' programs write it."""
    return "".join(f"{x} {y} {z} {s} 255 0 {k}\n" for k, (x, y, z, s) in enumerate(TABLE.tolist())).encode()


def put(path: Path, content: bytes) -> Path:
    """Write a file with this content."""
    path.write_bytes(content)
    return path


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=array.dtype.hasobject)
    return file.getvalue()


def npz(compressed: bool = False, **arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, allow_pickle=True, **arrays)
    return file.getvalue()


def sonar_packets(frames: int = 3) -> list[bytes]:
    """Range and strength image in turn, 3 x 4 pixels, some without an echo."""
    packets = []
    for frame in range(frames):
        pixels = np.arange(12).reshape(3, 4) * (frame + 1)
        packets += [rip.packb(range_image(frame, pixels)), rip.packb(strength_image(frame, 20 * pixels % 256))]
    return packets


SAMPLES: dict[str, tuple[str, bytes]] = {
    "ply ascii": (".ply", ply("ascii")),
    "ply little": (".ply", ply("binary_little_endian")),
    "ply big": (".ply", ply("binary_big_endian")),
    "ply ascii faces": (".ply", ply("ascii", faces=True)),
    "ply little faces": (".ply", ply("binary_little_endian", faces=True)),
    "ply big faces": (".ply", ply("binary_big_endian", faces=True)),
    "pcd ascii": (".pcd", pcd("ascii")),
    "pcd binary": (".pcd", pcd("binary")),
    "pcd compressed": (".pcd", pcd("binary_compressed")),
    "xyz": (".xyz", text()),
    "txt named by a comment": (".txt", text("\t", "# intensity z y x\n", (3, 2, 1, 0))),
    "csv": (".csv", text(";", "I;x;y;z\r\n", (3, 0, 1, 2), end="\r\n")),
    "pts": (".pts", b"5\n" + colored()),
    "asc": (".asc", colored()),
    "csv with decimal commas": (".csv", text(";", "x;y;z;i\n").replace(b".", b",")),
    "pcd with commas": (".pcd", pcd("ascii").replace(b".", b",").replace(b"# ,PCD v0,7", b"# .PCD v0.7")),
    "npy": (".npy", npy(TABLE)),
    "npy fortran big": (".npy", npy(np.asfortranarray(TABLE.astype(">f8")))),
    "npz": (".npz", npz(points=POINTS, strength=STRENGTH)),
    "npz deflated": (".npz", npz(compressed=True, arr_0=TABLE)),
    "sonar": (".sonar", b"".join(sonar_packets())),
}


SCALE = 1 / 1024  # exact in binary, as the numbers of TABLE are


def las(
    table: np.ndarray = TABLE,
    compressed: bool = True,
    form: int = 6,
    version: str = "1.4",
    gps: np.ndarray | None = None,
    adjusted: bool = True,
    offset: tuple[float, float, float] = (0.5, -3.0, 0.25),
    crs: object = None,
    extra: dict[str, np.ndarray] | None = None,
) -> bytes:
    """LAS or LAZ of x, y, z and intensity (N, 4). `gps` (N,) is adjusted standard GPS time or seconds of the week,
    `offset` [m] that of the header, `crs` one of pyproj, and `extra` holds more dimensions (N,), float64."""
    header = laspy.LasHeader(point_format=form, version=version)
    header.scales, header.offsets = np.full(3, SCALE), np.array(offset)
    header.global_encoding.gps_time_type = GpsTimeType.STANDARD if adjusted else GpsTimeType.WEEK_TIME
    for name in extra or {}:
        header.add_extra_dim(laspy.ExtraBytesParams(name, "f8"))
    if crs is not None:
        header.add_crs(crs)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (table[:, axis].astype(np.float64) for axis in range(3))
    cloud.intensity = np.round(table[:, 3])
    if gps is not None:
        cloud.gps_time = gps
    for name, values in (extra or {}).items():
        setattr(cloud, name, values)
    file = io.BytesIO()
    cloud.write(file, do_compress=compressed)
    return file.getvalue()
