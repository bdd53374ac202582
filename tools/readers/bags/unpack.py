"""Unpacks what recordings compress, and never more than a message or chunk can sensibly hold."""

import bz2
import tempfile
from collections.abc import Iterator
from pathlib import Path

from kernels.errors import InputError

LARGEST = 1 << 29  # bytes of a chunk, unpacked; recorders write a few MB each
ZSTD_START = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 22
# A file of clouds shrinks to a tenth; a hundred times that is no recording.
_RATIO, _FREE = 1000, 1 << 26


def unpacked(content: bytes, compression: str) -> bytes:
    """The plain bytes of a chunk.

    Args:
        content: compressed.
        compression: none (or empty), bz2, lz4 (frames) or zstd.

    Raises:
        InputError: a compression of another name, a chunk that was cut, or more than LARGEST bytes come of it.
    """
    if compression in ("", "none"):
        return content
    plain = bytearray()
    for piece in _pieces(content, compression):
        plain += piece
        if len(plain) > LARGEST:
            raise InputError(
                f"{len(content):,} bytes of {compression} unpack to more than {LARGEST:,}, which no recorder writes: "
                "the recording is damaged; copy it again"
            )
    return bytes(plain)


def _pieces(content: bytes, compression: str) -> Iterator[bytes]:
    """The plain bytes, _PIECE at a time: the libraries take room for as much as they are asked for."""
    if compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True) as stream:
            while piece := stream.read(_PIECE):
                yield piece
        return
    if compression == "bz2":
        decompressor = bz2.BZ2Decompressor()
    elif compression == "lz4":
        import lz4.frame

        decompressor = lz4.frame.LZ4FrameDecompressor()
    else:
        raise InputError(f"its compression is {compression[:40]!r}; wanted bz2, lz4 or zstd: write the recording again")
    yield decompressor.decompress(content, max_length=_PIECE)
    while not decompressor.eof:
        if decompressor.needs_input:
            raise InputError(
                f"{len(content):,} bytes of {compression} end too early: the recording is cut; copy it again"
            )
        yield decompressor.decompress(b"", max_length=_PIECE)


def unpack_file(path: Path, folder: Path) -> Path:
    """A file NAME.db3.zstd or NAME.mcap.zstd, unpacked into a folder.

    Raises:
        InputError: it is damaged, or claims more than its bytes can hold, or the folder has no room for it.
    """
    import zstandard

    plain = folder / path.stem
    written, most = 0, path.stat().st_size * _RATIO + _FREE
    try:
        with (
            path.open("rb") as file,
            zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as packed,
            plain.open("wb") as out,
        ):
            while piece := packed.read(_PIECE):
                written += out.write(piece)
                if written > most:
                    raise InputError(f"{path.name} unpacks to more than {most:,} bytes: it is damaged; copy it again")
    except zstandard.ZstdError as error:
        raise InputError(f"{path.name} cannot be unpacked ({error}); copy it again") from error
    except OSError as error:
        raise InputError(
            f"{path.name} cannot be unpacked to {tempfile.gettempdir()} ({error.strerror or error}); make room there, "
            f"or unpack it yourself with zstd -d {path.name}"
        ) from error
    return plain
