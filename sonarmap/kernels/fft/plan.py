"""Plan a Fourier transform: the layout of its array, and the launches that make it."""

from dataclasses import dataclass
from math import prod

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import EDGES, KINDS, row_pitch


@dataclass(frozen=True, slots=True)
class Layout:
    """The arrays of a transform of shape (n0, n1, n2).

    The real array is dense float32, its half spectrum (n0, n1, `row_pitch(n2)`), complex64, of which
    [..., :n2 / 2 + 1] is valid.
    """

    shape: tuple[int, int, int]  # number of points per axis
    batched: bool = False  # whether axis 0 is not transformed

    def __post_init__(self) -> None:
        edges = self.shape[1:] if self.batched else self.shape
        if len(self.shape) != 3 or any(edge not in EDGES for edge in edges) or self.shape[0] < 1:
            which = "the last two edges" if self.batched else "all of them"
            raise InputError(
                f"no Fourier transform of `shape={self.shape}`: it takes three edges, and {which} must be "
                f"{KINDS}. Pad the array, or choose another `edge`."
            )

    @property
    def row_points(self) -> int:
        """Complex points per row that are transformed: a real row is packed into half as many."""
        return self.shape[2] // 2

    @property
    def pitch(self) -> int:
        """Complex points from one row of the spectrum to the next."""
        return row_pitch(self.shape[2])

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
        return prod(self.shape[1:] if self.batched else self.shape)

    def row_scale(self, inverse: bool) -> float:
        """What a row is multiplied with: an inverse is divided by the points, of which a packed row has half."""
        return 2 / self.points if inverse else 1.0


@dataclass(frozen=True, slots=True)
class Pass:
    """One kernel launch over the whole array: the kernel's name and its numbers of groups and work-items."""

    kernel: str
    groups: int
    group_size: int = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """A program and the launches, in order, that make it a transform.

    Every kernel takes the arrays (volume, spectrum), how many floats into their memory they begin, and behind them the
    table where there is one.
    """

    source: str  # OpenCL C
    passes: tuple[Pass, ...]  # the launches, in order
    table: np.ndarray | None = None  # (n,) float32, twiddle factors to be put into the device's memory, or None
