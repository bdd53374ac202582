"""The edges that have a Fourier transform: even products of 2, 3 and 5; how their rows lie, and their radices."""

from functools import lru_cache
from itertools import combinations_with_replacement
from math import prod

_SMALLEST, _LARGEST = 16, 512
# The radices, and the time of a stage per point as measured, in a unit of its own; larger ones do not fit the
# registers.
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
    """The two allowed edges nearest to one that is not: below and above it, or the last two at an end."""
    above = next((n for n, allowed in enumerate(EDGES) if allowed > edge), len(EDGES))
    first = min(max(above - 1, 0), len(EDGES) - 2)
    return EDGES[first], EDGES[first + 1]


def row_pitch(length: int) -> int:
    """Complex numbers from one row of a half spectrum to the next, for real rows of this many numbers.

    Of them length / 2 + 1 are valid. The rest pads the row to whole blocks of 8, so that rows are aligned to the lines
    of the cache and columns are out of each other's way in it.
    """
    return (length // 2 // _BLOCK + 1) * _BLOCK


@lru_cache
def radices(n: int) -> tuple[int, ...]:
    """The radices of a transform of n points, ascending, in the order of its stages: those that cost least.

    Small first radices leave the most work to the stages whose operands are in the first-level cache. From 16 points on
    there are two stages at least: one that reads memory and one that writes it.
    """
    counts = range(1 if n < _SMALLEST else 2, _MOST_STAGES + 1)
    every = (chosen for count in counts for chosen in combinations_with_replacement(_COSTS, count))
    return min((chosen for chosen in every if prod(chosen) == n), key=lambda chosen: sum(_COSTS[r] for r in chosen))
