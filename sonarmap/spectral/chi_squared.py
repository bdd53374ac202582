"""Quantiles of chi-squared, the sum of the squares of some independent standard normal numbers.

Not by scipy.stats, which takes half a second to load.
"""

from typing import Any

import numpy as np
from scipy.special import gammaincc, gammainccinv, gammaincinv


def chi_squared(probability: float, numbers: int | np.ndarray) -> Any:
    """What chi-squared of so many numbers is less than with a probability; an array where an argument is one."""
    return 2 * gammaincinv(np.asarray(numbers) / 2, probability)


def chi_squared_beyond(probability: float | np.ndarray, numbers: int | np.ndarray) -> Any:
    """What it is more than with a probability, however small that is."""
    return 2 * gammainccinv(np.asarray(numbers) / 2, probability)


def beyond_sigmas(sigmas: float, numbers: int) -> float:
    """What it is more than as seldom as one number is off by so many standard deviations."""
    return float(chi_squared_beyond(gammaincc(0.5, sigmas**2 / 2), numbers))
