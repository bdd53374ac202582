"""NumPy's .npy, one array (N, 3) or (N, 4), and .npz, a zip archive of arrays, without pickled objects.

NumPy parses only the header. Memory for an array is allocated only if the file holds as many bytes, and an archive is
unpacked only to a size in proportion to the file's.
"""

import io
import math
import struct
import warnings
import zipfile
import zlib
from dataclasses import replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.clouds.rows import require_believable, require_bytes
from sonarmap.tools.files.readers.instruments import LARGEST_STAMP
from sonarmap.tools.files.user_file import naming

_HEADER_LIMIT = 10_000  # characters
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_OPTIONAL = ("strength", "stamp", "viewpoints", "times")
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, NotImplementedError, RuntimeError,
    ValueError, IndexError, KeyError, OverflowError,
)  # fmt: skip


def read_npy(content: bytes) -> list[Cloud]:
    """The points of a .npy file: columns x, y, z and perhaps strength."""
    return [cloud_of_array(parse_npy(content))]


def cloud_of_array(points: np.ndarray, strength: np.ndarray | None = None, stamp: float | None = None) -> Cloud:
    """The cloud of an array (N, 3), or (N, 4) with the strength last where none is given beside it."""
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise InputError(f"an array of shape {points.shape}; wanted (N, 3) or, with strength, (N, 4)")
    if points.shape[1] == 4 and strength is None:
        strength = points[:, 3]
    if strength is not None and strength.shape != (len(points),):
        raise InputError(f"strength has shape {strength.shape}; wanted ({len(points)},), one per point")
    return Cloud(points[:, :3], strength, stamp)


def parse_npy(content: bytes) -> np.ndarray:
    """The array of a .npy file, integers or floating point, without copying it."""
    file = io.BytesIO(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers that Python 2 wrote
            read = _HEADERS[np.lib.format.read_magic(file)]
            shape, is_fortran, dtype = read(file, max_header_size=_HEADER_LIMIT)
    except Exception as error:  # NumPy and Python's parser raise anything for a damaged header
        raise InputError(f"its NPY header is damaged ({error}); save the array again") from error
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        kind = "objects" if dtype.hasobject else "fields" if dtype.fields else dtype
        raise InputError(f"an array of {kind}; wanted plain numbers: save np.asarray(points, np.float32)")
    if len(shape) > 2 or min(shape, default=0) < 0:
        raise InputError(f"its NPY header has shape {shape}; wanted (N, 3) or (N, 4)")
    count, start = math.prod(shape), file.tell()
    require_bytes(f"{count:,} numbers of {dtype}", count * dtype.itemsize, len(content) - start)
    if len(content) - start > count * dtype.itemsize:
        raise InputError(f"the header promises shape {shape} of {dtype}, more than follows: it is damaged, or several")
    return np.frombuffer(content, dtype, count, start).reshape(shape, order="F" if is_fortran else "C")


def read_npz(content: bytes) -> list[Cloud]:
    """Read the points of a .npz file: `points`, optionally `strength`, `stamp`, `viewpoints`, `times`; or one array."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
        members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
    except _DAMAGE as error:
        raise InputError(f"it is not a whole zip archive ({error}); save or copy it again") from error
    if "points" not in members and len(members) != 1:
        raise InputError(
            f"its arrays are {', '.join(sorted(members)) or '(none)'}; wanted 'points' of shape (N, 3) and "
            f"perhaps {', '.join(map(repr, _OPTIONAL))}, or one single array"
        )
    names = ("points", *_OPTIONAL) if "points" in members else tuple(members)
    arrays = {name: _read_member(archive, members[name]) for name in names if name in members}
    cloud = cloud_of_array(arrays[names[0]], arrays.get("strength"), _stamp_of(arrays.get("stamp")))
    count = len(cloud.points)
    for name, shape in (("viewpoints", (count, 3)), ("times", (count,))):
        if name in arrays and arrays[name].shape != shape:
            raise InputError(f"{name} has shape {arrays[name].shape}; wanted {shape}, one per point")
    return [replace(cloud, viewpoints=arrays.get("viewpoints"), times=arrays.get("times"))]


def _stamp_of(stamp: np.ndarray | None) -> float | None:
    if stamp is None:
        return None
    if stamp.size != 1 or not (np.abs(stamp) <= LARGEST_STAMP).all():
        raise InputError(f"stamp has shape {stamp.shape}; wanted one finite number, seconds in UTC")
    return float(stamp.reshape(-1)[0])


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """The array of a member, if its claimed size is in proportion to its compressed size."""
    named = f"its member {member.filename!r}"
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{named} has a compression that NumPy does not use; save it again")
    require_believable(named, member.compress_size, member.file_size)
    require_memory(named, member.file_size, "thin its points out first")
    try:
        with archive.open(member) as file:
            body = file.read(member.file_size)  # without a size, a member larger than it claims would be unpacked
    except _DAMAGE as error:
        raise InputError(f"{named} is damaged ({error}); save it again") from error
    with naming(named):
        return parse_npy(body)
