"""NumPy's .npz: a zip archive of arrays, never pickled, never unpacked beyond what its size makes likely."""

import io
import struct
import zipfile
import zlib
from dataclasses import replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.clouds.npy import cloud_of_array, parse_npy
from sonarmap.tools.files.readers.clouds.packed import require_believable
from sonarmap.tools.files.readers.limits import LARGEST_STAMP

_OPTIONAL = ("strength", "stamp", "viewpoints", "times")
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, NotImplementedError, RuntimeError,
    ValueError, IndexError, KeyError, OverflowError,
)  # fmt: skip


def read_npz(content: bytes) -> list[Cloud]:
    """The points of a .npz file: `points`, perhaps `strength`, `stamp`, `viewpoints`, `times`; or its only array.
    Raises InputError: damage, arrays of objects, other names or shapes, an unbelievable compression."""
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
    _require_believable(member)
    require_memory(f"its member {member.filename!r}", member.file_size, "thin its points out first")
    try:
        with archive.open(member) as file:
            body = file.read(member.file_size)  # without a size, a member that lies about its own would be unpacked
    except _DAMAGE as error:
        raise InputError(f"its member {member.filename!r} is damaged ({error}); save it again") from error
    try:
        return parse_npy(body)
    except InputError as error:
        raise InputError(f"its member {member.filename!r}: {error}") from error


def _require_believable(member: zipfile.ZipInfo) -> None:
    """Memory stays in proportion to the file, whatever the archive claims."""
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"its member {member.filename!r} is not compressed as NumPy does it; save it again")
    require_believable(f"its member {member.filename!r}", member.compress_size, member.file_size)
