"""The edges that Fourier transforms support, and the plan of one: the layout of its arrays, and its launches."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from math import prod

import numpy as np

from sonarmap.kernels.errors import InputError

_SMALLEST = 16
_LARGEST = 512
# Radix -> measured time of a stage per point, in arbitrary units; larger radices do not fit into registers.
_COSTS = {2: 0.8, 3: 0.9, 4: 1.05, 5: 1.2, 6: 1.3, 8: 1.5, 9: 1.7, 10: 1.75}
_MOST_STAGES = 4
_BLOCK = 8  # adjacent columns that are transformed together


def is_smooth(n: int) -> bool:
    """Whether a number has no prime factor above 5."""
    for factor in (2, 3, 5):
        while n > 1 and n % factor == 0:
            n //= factor
    return n == 1


EDGES = tuple(n for n in range(_SMALLEST, _LARGEST + 1, 2) if is_smooth(n))
KINDS = f"even products of 2, 3 and 5 from {_SMALLEST} to {_LARGEST}"


def neighbors(edge: int) -> tuple[int, int]:
    """The allowed edges below and above one that is not allowed; at an end of the range, the last two."""
    above = next((n for n, allowed in enumerate(EDGES) if allowed > edge), len(EDGES))
    first = min(max(above - 1, 0), len(EDGES) - 2)
    return EDGES[first], EDGES[first + 1]


def row_pitch(length: int) -> int:
    """Complex numbers from one row of a half spectrum to the next: length / 2 + 1 valid ones, padded to blocks of 8 to
    align rows to cache lines."""
    return (length // 2 // _BLOCK + 1) * _BLOCK


@lru_cache
def radices(n: int) -> tuple[int, ...]:
    """The cheapest radices of a transform of n points, ascending, in the order of its stages. From 16 points on there
    are at least two stages: one that reads memory and one that writes it."""
    counts = range(1 if n < _SMALLEST else 2, _MOST_STAGES + 1)
    every = (chosen for count in counts for chosen in combinations_with_replacement(_COSTS, count))
    return min((chosen for chosen in every if prod(chosen) == n), key=lambda chosen: sum(_COSTS[r] for r in chosen))


@dataclass(frozen=True, slots=True)
class Layout:
    """The arrays of a transform of shape (n0, n1, n2): dense float32, and its half spectrum (n0, n1, `row_pitch(n2)`)
    complex64, of which [..., :n2 / 2 + 1] is valid."""

    shape: tuple[int, int, int]  # number of points per axis
    batched: bool = False  # whether axis 0 is not transformed

    def __post_init__(self) -> None:
        edges = self.shape[1:] if self.batched else self.shape
        if len(self.shape) != 3 or any(edge not in EDGES for edge in edges) or self.shape[0] < 1:
            which = "the last two" if self.batched else "all"
            raise InputError(
                f"`shape={self.shape}` has no Fourier transform; wanted three edges, {which} of them {KINDS}. "
                "Pad the array, or choose another `edge`."
            )

    @property
    def row_points(self) -> int:
        """Complex points per row of the transform: a real row is packed into half as many."""
        return self.shape[2] // 2

    @property
    def pitch(self) -> int:
        """Complex points from one row of the spectrum to the next."""
        return row_pitch(self.shape[2])

    @property
    def column_blocks(self) -> int:
        """Number of blocks of 8 adjacent columns that hold all valid ones."""
        return self.row_points // 8 + 1

    @property
    def spectrum_shape(self) -> tuple[int, int, int]:
        """Shape of the spectrum's array, padding included."""
        return (self.shape[0], self.shape[1], self.pitch)

    @property
    def points(self) -> int:
        return prod(self.shape[1:] if self.batched else self.shape)

    def row_scale(self, inverse: bool) -> float:
        """The factor of a row: an inverse divides by the number of points, which packing halves."""
        return 2 / self.points if inverse else 1.0


@dataclass(frozen=True, slots=True)
class Pass:
    """One kernel launch over the whole array: the kernel's name and its numbers of groups and work-items."""

    kernel: str
    groups: int
    group_size: int = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """Program and launches of a transform. Every kernel takes the buffers of volume and spectrum, their arrays' offsets
    in them [floats], and the table if there is one."""

    source: str  # OpenCL C
    passes: tuple[Pass, ...]  # the launches, in order
    table: np.ndarray | None = None  # (n,) float32, twiddle factors for global memory, or None
