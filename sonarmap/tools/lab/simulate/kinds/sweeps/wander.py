"""What moves a vehicle, and the errors of what it believes of that: slow random walks and quick wobbles."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

SLOW = 1 / 30  # of a sweep: a walk's steps are alike over about this share of it


def walk(count: int, sigmas: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """A random walk that is 0 in the middle, with smooth steps: drift that grows with the square root of time.

    Args:
        count: of steps, over the whole sweep.
        sigmas: standard deviation of each coordinate at either end.

    Returns:
        (count, len(sigmas)) float64.
    """
    steps = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), max(SLOW * count, 1e-3), axis=0)
    path = np.cumsum(steps, axis=0) * np.sqrt(2 / count)
    return (path - path[count // 2]) * sigmas


def wobble(count: int, sigmas: tuple[float, ...], width: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary random motion, alike over about `width` steps, with these standard deviations.

    Returns:
        (count, len(sigmas)) float64.
    """
    smooth = gaussian_filter1d(rng.standard_normal((count, len(sigmas))), width, axis=0, mode="wrap")
    # the smoothing kernel's energy: what is left of the variance of white noise
    kernel = np.zeros(count)
    kernel[count // 2] = 1.0
    left = np.sqrt((gaussian_filter1d(kernel, width, mode="wrap") ** 2).sum())
    return smooth / left * sigmas
