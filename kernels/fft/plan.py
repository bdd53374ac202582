# pyright: strict
"""Plan a Fourier transform: the layout of its array, the radices of an edge, the launches that make it."""

from dataclasses import dataclass
from math import prod

from kernels.errors import InputError

# Small first radices leave the most work to the stages whose operands are in the first-level cache. 8 points
# are the rows of a real edge of 16.
RADICES: dict[int, tuple[int, ...]] = {
    8: (8,),
    16: (4, 4),
    32: (4, 8),
    64: (4, 4, 4),
    128: (4, 4, 8),
    256: (4, 8, 8),
    512: (4, 8, 16),
}
EDGES = (16, 32, 64, 128, 256, 512)


@dataclass(frozen=True, slots=True)
class Layout:
    """The arrays of a transform of shape (n0, n1, n2).

    The real array is dense float32, its half spectrum (n0, n1, n2 / 2 + 8), complex64, of which
    [..., :n2 / 2 + 1] is valid. The padding keeps the rows of a column out of each other's way in the cache, and
    rows aligned to its lines.

    Attributes:
        shape: number of points per axis.
        batched: whether axis 0 is not transformed.

    Raises:
        InputError: a transformed edge is not one of `EDGES`, or there is no layer.
    """

    shape: tuple[int, int, int]
    batched: bool = False

    def __post_init__(self) -> None:
        edges = self.shape[1:] if self.batched else self.shape
        if len(self.shape) != 3 or any(edge not in EDGES for edge in edges) or self.shape[0] < 1:
            which = "the last two edges" if self.batched else "every edge"
            raise InputError(
                f"no Fourier transform of `shape={self.shape}`: it takes three edges, and {which} must be "
                f"one of {', '.join(map(str, EDGES))}. Pad the array, or choose another `edge`."
            )

    @property
    def row_points(self) -> int:
        """Complex points per row that are transformed: a real row is packed into half as many."""
        return self.shape[2] // 2

    @property
    def pitch(self) -> int:
        """Complex points from one row of the spectrum to the next."""
        return self.row_points + 8

    @property
    def column_blocks(self) -> int:
        """Blocks of 8 adjacent columns that hold every valid one."""
        return self.row_points // 8 + 1

    @property
    def spectrum_shape(self) -> tuple[int, int, int]:
        """Shape of the spectrum's array, padding included."""
        return (self.shape[0], self.shape[1], self.pitch)

    @property
    def points(self) -> int:
        """Number of points of one transform, which the inverse divides by."""
        return prod(self.shape[1:] if self.batched else self.shape)


@dataclass(frozen=True, slots=True)
class Pass:
    """One kernel launch over the whole array: the kernel's name and its numbers of groups and work-items."""

    kernel: str
    groups: int
    group_size: int = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """A program and the launches, in order, that make it a transform.

    Every kernel takes the arrays (volume, spectrum).
    """

    source: str
    passes: tuple[Pass, ...]
