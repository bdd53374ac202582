"""Damaged copies of a file: bytes, numbers, lengths and lines changed, lost, doubled, or taken from another file."""

import re
import struct
from collections.abc import Callable

import numpy as np

HOSTILE_NUMBERS = (
    b"1e308", b"-1e308", b"1e200", b"-1", b"0", b"1e-308", b"2147483648", b"4294967296", b"9223372036854775808",
    b"1000000000000", b"9" * 40, b"nan", b"inf", b"-inf", b"1_0", b"",
)  # fmt: skip
HOSTILE_LENGTHS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1)
_NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?")


def mutated(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """The content of a file with one or two random damages; pieces may come from the content `other`."""
    for _ in range(1 + (rng.random() < 0.3)):
        damage = _DAMAGES[rng.integers(len(_DAMAGES))]
        content = damage(content, other, rng) or b"\0"
    return content


def _place(content: bytes, rng: np.random.Generator) -> int:
    """Random position of a byte; half of them are near the beginning, where headers are."""
    return int(rng.integers(min(len(content), 400) if rng.integers(2) else len(content)))


def _flipped(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    changed[_place(content, rng)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _other_byte(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    place, added = _place(content, rng), bytes([int(rng.choice(list(b"0129-+. \n\xff\0")))])
    return content[:place] + added + content[place + int(rng.integers(2)) :]


def _cut(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    return content[: _place(content, rng)]


def _without_piece(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted((_place(content, rng), _place(content, rng)))
    return content[:first] + content[last:]


def _doubled_piece(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted((_place(content, rng), _place(content, rng)))
    return content[:last] + content[first:]


def _hostile_number(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    numbers = list(_NUMBER.finditer(content[:4000]))
    if not numbers:
        return content
    number = numbers[rng.integers(len(numbers))]
    return content[: number.start()] + HOSTILE_NUMBERS[rng.integers(len(HOSTILE_NUMBERS))] + content[number.end() :]


def _hostile_length(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    place, form = _place(content, rng), "<>"[rng.integers(2)] + "BHIQ"[rng.integers(4)]
    width = struct.calcsize(form)
    value = HOSTILE_LENGTHS[rng.integers(len(HOSTILE_LENGTHS))] % 2 ** (8 * width)
    return content[:place] + struct.pack(form, value) + content[place + width :]


def _filled_piece(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    """50 bytes of 0 or 255, as faulty disks and memory cards produce."""
    place = _place(content, rng)
    return content[:place] + bytes([255 * int(rng.integers(2))]) * 50 + content[place + 50 :]


def _other_lines(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    """A line lost, doubled, or swapped with another."""
    lines = content.splitlines(keepends=True)
    taken, placed = rng.integers(len(lines), size=2).tolist()
    match rng.integers(3):
        case 0:
            del lines[taken]
        case 1:
            lines.insert(placed, lines[taken])
        case _:
            lines[taken], lines[placed] = lines[placed], lines[taken]
    return b"".join(lines)


def _spliced(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    return content[: _place(content, rng)] + other[_place(other, rng) :]


_DAMAGES: tuple[Callable[[bytes, bytes, np.random.Generator], bytes], ...] = (
    _flipped, _other_byte, _cut, _without_piece, _doubled_piece, _hostile_number, _hostile_length, _filled_piece,
    _other_lines, _spliced,
)  # fmt: skip
