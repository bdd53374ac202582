"""What a refinement says of its poses: the rows of numbers that its kernels fill, and their meaning."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError

# As real.cl has them: the numbers of a state; where the sums begin and how many they are; where the doubts and the next
# state begin; and how long a row is.
STATE, SUMS, SUMS_COUNT, DOUBTS, NEXT, LENGTH = 15, 16, 208, 272, 280, 296


@dataclass(frozen=True, slots=True)
class Record:
    """Where k poses are, the sums of the last step there, and where it leads; float64."""

    turn: np.ndarray  # (k, 3, 3) and
    shift: np.ndarray  # (k, 3), p_target = R p_source + shift about the grid centers [voxels]
    width: np.ndarray  # (k,) how far the surfaces usually are apart [voxels]
    stretch: np.ndarray  # (k, 2) of the source and of the target
    # moving, whole, shared: (k, 8, 8) sums of the weights times the gaps' derivatives, by turn, shift and stretches: of
    # the pairs that move the pose, of all, and with one scan's normals times the other's (not symmetric)
    moving: np.ndarray
    whole: np.ndarray
    shared: np.ndarray
    gradient: np.ndarray  # (k, 8) of the pairs that move the pose, times the gaps
    # total, squares: (k,) of the weights, and times the squared gaps
    total: np.ndarray
    squares: np.ndarray
    doubts: np.ndarray  # (k, 6) sums of the squares of what each pair adds to `shared` along the principal axes
    # next_turn, next_shift, next_stretch: where the step leads, if the pairs alone decide
    next_turn: np.ndarray
    next_shift: np.ndarray
    next_stretch: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray) -> "Record":
        """From rows (k, LENGTH) as real.cl has them."""
        rows = rows.astype(np.float64)
        moving, whole, shared = rows[:, SUMS : SUMS + 192].reshape(-1, 3, 8, 8).transpose(1, 0, 2, 3)
        state, following = rows[:, :STATE], rows[:, NEXT : NEXT + STATE]
        return cls(
            turn=state[:, :9].reshape(-1, 3, 3),
            shift=state[:, 9:12],
            width=state[:, 12],
            stretch=state[:, 13:],
            moving=moving,
            whole=whole,
            shared=shared,
            gradient=rows[:, SUMS + 192 : SUMS + 200],
            total=rows[:, SUMS + 200],
            squares=rows[:, SUMS + 201],
            doubts=rows[:, DOUBTS : DOUBTS + 6],
            next_turn=following[:, :9].reshape(-1, 3, 3),
            next_shift=following[:, 9:12],
            next_stretch=following[:, 13:],
        )


def state_rows(turn: np.ndarray, shift: np.ndarray, width: np.ndarray, stretch: np.ndarray | None) -> np.ndarray:
    """Rows (k, LENGTH) float64 to begin with, of rotations (k, 3, 3), shifts (k, 3), widths (k,), stretches (k, 2)."""
    rows = np.zeros((len(shift), LENGTH))
    rows[:, :9], rows[:, 9:12], rows[:, 12] = turn.reshape(-1, 9), shift, width
    rows[:, 13:STATE] = 0 if stretch is None else stretch
    if not np.isfinite(rows).all():
        raise InputError(f"a pose to refine is not finite: rotations {turn.tolist()}, shifts {shift.tolist()}")
    return rows
