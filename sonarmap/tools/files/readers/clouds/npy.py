"""NumPy's .npy: one array (N, 3) or (N, 4), never pickled.

The header is read here and not by NumPy, whose reader evaluates it, warns, and allocates what it promises.
Format: numpy.lib.format.
"""

import re
import struct

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.clouds.rows import require_bytes

_MAGIC = b"\x93NUMPY"
_HEADER_LIMIT = 10_000
_DESCR = re.compile(r"""['"]descr['"]\s*:\s*(?:['"]([^'"]*)['"]|\[)""")
_FORTRAN = re.compile(r"""['"]fortran_order['"]\s*:\s*(True|False)""")
_SHAPE = re.compile(r"""['"]shape['"]\s*:\s*\(([\d,\sL-]*)\)""", re.ASCII)
_PLAIN = re.compile(r"[<>|=]?(f[248]|[iu][1248])")


def read_npy(content: bytes) -> list[Cloud]:
    """The points of a .npy file: columns x, y, z and perhaps strength. Raises InputError: a damaged header, objects or
    structures inside, another shape, fewer bytes than promised."""
    return [cloud_of_array(parse_npy(content))]


def cloud_of_array(points: np.ndarray, strength: np.ndarray | None = None, stamp: float | None = None) -> Cloud:
    """The cloud of an array (N, 3), or (N, 4) with the strength last where none is given beside it. Raises InputError:
    another shape, or a strength for another number of points."""
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise InputError(f"an array of shape {points.shape}; wanted (N, 3) or, with strength, (N, 4)")
    if points.shape[1] == 4 and strength is None:
        strength = points[:, 3]
    if strength is not None and strength.shape != (len(points),):
        raise InputError(f"strength has shape {strength.shape}; wanted ({len(points)},), one per point")
    return Cloud(points[:, :3], strength, stamp)


def parse_npy(content: bytes) -> np.ndarray:
    """The array of a .npy file, integers or floating point, without copying it."""
    header, start = _header_of(content)
    descr, fortran, shape = (pattern.search(header) for pattern in (_DESCR, _FORTRAN, _SHAPE))
    if descr is None or fortran is None or shape is None:
        raise InputError("its NPY header is damaged; save the array again")
    if _PLAIN.fullmatch(descr[1] or "") is None:
        kind = "objects" if (descr[1] or "").endswith("O") else "fields" if descr[1] is None else descr[1]
        raise InputError(
            f"an array of {kind}; wanted plain numbers (objects would be unpickled, which runs code): save "
            "np.asarray(points, np.float32)"
        )
    lengths = [part.strip() for part in shape[1].split(",") if part.strip()]
    if len(lengths) > 2 or any(re.fullmatch(r"\d{1,18}", length, re.ASCII) is None for length in lengths):
        raise InputError(f"its NPY header asks for shape ({shape[1]}); wanted (N, 3) or (N, 4)")
    sizes = [int(length) for length in lengths]
    dtype = np.dtype(descr[1])
    count = int(np.prod(np.array(sizes, dtype=object)))  # Python's integers: 10^18 squared does not wrap
    require_bytes(f"{count:,} numbers of {dtype}", count * dtype.itemsize, len(content) - start)
    if len(content) - start > count * dtype.itemsize:
        raise InputError(
            f"the header promises shape ({shape[1]}) of {dtype} and more bytes than that follow: "
            "the file is damaged or holds several arrays; save one array per file"
        )
    values = np.frombuffer(content, dtype, count, start)
    return values.reshape(sizes, order="F" if fortran[1] == "True" else "C")


def _header_of(content: bytes) -> tuple[str, int]:
    """The header's text and the byte where the numbers start."""
    if not content.startswith(_MAGIC) or content[6:8] not in (b"\x01\x00", b"\x02\x00", b"\x03\x00"):
        raise InputError("its first bytes are not those of a .npy array of version 1, 2 or 3; save the array again")
    width, form = (2, "<H") if content[6] == 1 else (4, "<I")
    require_bytes("a header length", width, len(content) - 8)
    (length,) = struct.unpack_from(form, content, 8)
    start = 8 + width + length
    if length > _HEADER_LIMIT:
        raise InputError(f"its NPY header claims {length:,} bytes; it is damaged: save the array again")
    require_bytes("a header", length, len(content) - 8 - width)
    return content[8 + width : start].decode("latin-1"), start
