"""How uncertain a transform is, in two numbers."""

import numpy as np


def worst_sigmas(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The standard deviations of covariances (..., 6, 6), rotation first, along their worst directions.

    Returns:
        of the rotation [rad] and of the translation [m], (...) each: the roots of the largest eigenvalues of the two
        diagonal blocks, which no choice of axes changes.
    """
    blocks = covariance[..., :3, :3], covariance[..., 3:, 3:]
    rotation, translation = (np.sqrt(np.linalg.eigvalsh(block)[..., -1]) for block in blocks)
    return rotation, translation
