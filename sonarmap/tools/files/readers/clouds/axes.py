"""Names of the axes of points in files, a letter for each of x, y, z: frd is x forward, y right, z down."""

import numpy as np

from sonarmap.kernels.errors import InputError

_UPWARD = {"u": (0, 0, 1), "d": (0, 0, -1)}
_OF_SENSOR = {"f": (1, 0, 0), "b": (-1, 0, 0), "l": (0, 1, 0), "r": (0, -1, 0), **_UPWARD}
_OF_WORLD = {"e": (1, 0, 0), "w": (-1, 0, 0), "n": (0, 1, 0), "s": (0, -1, 0), **_UPWARD}


def axes_matrix(name: str) -> np.ndarray:
    """(3, 3) int, whose columns are the file's x, y, z in forward, left, up, or, of axes named by compass points, in
    East, North, Up. It mirrors where the axes are left-handed. Raises InputError: no three axes have this name."""
    for known in (_OF_SENSOR, _OF_WORLD):
        if len(name) == 3 and set(name) <= known.keys():
            matrix = np.array([known[letter] for letter in name]).T
            if np.abs(matrix).sum(axis=1).all():  # each direction once
                return matrix
    raise InputError(
        f"{name!r} is not known; name the directions of x, y and z, as flu (forward, left, up), frd (forward, right, "
        "down), rdf (cameras) or ned (North, East, Down)"
    )
