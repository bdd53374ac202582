"""The true transforms between numbered scans, as benchmarks of registration call them: gt.log.

For every pair a line `i j`, or `i j n` with any number n, then the four rows of a 4 x 4 matrix that maps points of
scan j into the frame of scan i. Format: http://redwood-data.org/indoor/fileformat.html
"""

import re
from dataclasses import dataclass
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.rows import Line, shown
from sonarmap.tools.files.readers.poses.pose_rows import finite_rows, read_lines, rigid_transform
from sonarmap.tools.files.user_file import naming

GT_LOG = "gt.log"
_LINES = 5  # of a pair
_NUMBERS = re.compile(rb"\s*(\d{1,9})\s+(\d{1,9})(\s+\d{1,9})?\s*")


@dataclass(frozen=True, slots=True)
class TruePair:
    """The truth of one pair."""

    i: int  # i, j: the numbers of the target and the source
    j: int
    T_i_j: RigidTransform  # p_i = T_i_j p_j [m]
    line: int  # of the file, where it begins


def read_gt_log(path: Path) -> tuple[TruePair, ...]:
    """All pairs of the file, in its order. Raises InputError: naming the file and the line: numbers or a matrix that
    are none, a matrix that is no rigid transform, a scan paired with itself, a pair that is there twice, in whichever
    direction."""
    lines = read_lines(path)
    starts = range(0, len(lines), _LINES)
    pairs = [_pair(path, lines[start : start + _LINES]) for start in starts]
    known: dict[frozenset[int], TruePair] = {}
    for pair in pairs:
        before = known.setdefault(frozenset((pair.i, pair.j)), pair)
        if before is not pair:
            raise InputError(
                f"{path}: lines {before.line} and {pair.line} are both for the scans {pair.i} and {pair.j}; delete one"
            )
    return tuple(pairs)


def _pair(path: Path, block: list[Line]) -> TruePair:
    number, text = block[0]
    match = _NUMBERS.fullmatch(text)
    if match is None:
        raise InputError(
            f"{path}: line {number} is {shown(text)}; wanted the numbers of two scans, as 0 1, and the four rows of "
            "their matrix in the lines below; fix that line"
        )
    i, j = int(match[1]), int(match[2])
    if i == j:
        raise InputError(f"{path}: line {number} pairs the scan {i} with itself; wanted two scans; delete that pair")
    if len(block) < _LINES:
        raise InputError(
            f"{path}: the pair in line {number} has {len(block) - 1} lines of its matrix; wanted four: the file may be "
            "cut; copy it again"
        )
    matrix = finite_rows(path, block[1:], "r r r t")
    with naming(path):
        T_i_j = rigid_transform(matrix, f"the pair in line {number}")
    return TruePair(i, j, T_i_j, number)
