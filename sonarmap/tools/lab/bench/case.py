"""A benchmark case: a kernel, and the bytes that it moves.

The bytes are those that the algorithm must move: the valid elements of each input and output array, once. A transform
in three dimensions passes over its array twice, along rows and columns and along the first axis, as no cache holds it.
"""

from collections.abc import Callable
from dataclasses import dataclass

BLUR = 0.7  # standard deviation of the blur in the correlation over translations [voxels]


@dataclass(frozen=True, slots=True)
class Peer:
    """Another library that does the same work."""

    name: str  # of the library
    run: Callable[[], object]  # do the work and wait for its end
    restore: Callable[[], object] = lambda: None  # restore input that `run` overwrites


@dataclass(frozen=True, slots=True)
class KernelCase:
    """A kernel on one input."""

    name: str  # of the kernel in its module
    moved: int  # bytes that the algorithm must move
    run: Callable[[], object]  # queue the kernel's work without waiting for it
    restore: Callable[[], object] = lambda: None  # restore input that `run` overwrites
    peers: Callable[[], list[Peer]] = list  # create the peers
