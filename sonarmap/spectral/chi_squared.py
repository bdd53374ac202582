"""Quantiles of chi-squared, the sum of the squares of some independent standard normal numbers.

Not by scipy.stats, which takes half a second to load.
"""

from typing import Any

import numpy as np
from scipy.special import gammaincc, gammainccinv, gammaincinv


def chi_squared(probability: float, numbers: int | np.ndarray) -> Any:
    """The quantile of chi-squared at a probability, with `numbers` degrees of freedom; an array for arrays."""
    return 2 * gammaincinv(np.asarray(numbers) / 2, probability)


def chi_squared_beyond(probability: float | np.ndarray, numbers: int | np.ndarray) -> Any:
    """The value that chi-squared exceeds with a probability, however small that is."""
    return 2 * gammainccinv(np.asarray(numbers) / 2, probability)


def beyond_sigmas(sigmas: float, numbers: int) -> float:
    """The value that chi-squared exceeds as seldom as a normal number is off by `sigmas` standard deviations."""
    return float(chi_squared_beyond(gammaincc(0.5, sigmas**2 / 2), numbers))
