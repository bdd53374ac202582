"""Lines of straight legs, their corners rounded: where pipes run and where lanes turn."""

import numpy as np


def rounded(corners: np.ndarray, bend: float, pieces: int = 6) -> np.ndarray:
    """The corners (K, D) [m] with every inner one replaced by a curve.

    The curve, a parabola, runs from `bend` [m] before the corner to `bend` behind it, or from a little less than
    half of a leg that is too short for that.
    """
    if bend <= 0 or len(corners) < 3:
        return corners
    share = np.linspace(0, 1, pieces + 1)[:, None]
    line = [corners[:1]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        reach = [min(bend, 0.45 * float(np.linalg.norm(end - corner))) for end in (before, after)]
        enter = corner + reach[0] * (before - corner) / np.linalg.norm(before - corner)
        leave = corner + reach[1] * (after - corner) / np.linalg.norm(after - corner)
        line.append((1 - share) ** 2 * enter + 2 * share * (1 - share) * corner + share**2 * leave)
    return np.concatenate([*line, corners[-1:]])
