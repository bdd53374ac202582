"""What kind of file some bytes are, whatever their name says."""

import re

PLY = "a PLY file"
PCD = "a PCD file"
NPY = "a NumPy .npy array"
NPZ = "a zip archive, as NumPy's .npz is"
SONAR = "a Sonar 3D-15 recording"
TEXT = "text"
BINARY = "binary content of no known kind"

_PLY = re.compile(rb"ply[ \t]*[\r\n]")
_PCD = re.compile(rb"# ?\.PCD|(?:\s*#[^\n]*\n)*\s*VERSION\s+0?\.\d")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
_LOOKED_AT = 4096


def kind_of(content: bytes) -> str:
    """One of the constants above, by the first bytes of a file."""
    head = content[:_LOOKED_AT]
    if _PLY.match(head):
        return PLY
    if _PCD.match(head):
        return PCD
    if head.startswith(b"\x93NUMPY"):
        return NPY
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return NPZ
    if head.startswith((b"RIP1", b"RIP2")):
        return SONAR
    return BINARY if _CONTROL.search(head) else TEXT
