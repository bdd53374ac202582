"""Quantiles of the chi-squared distribution.

scipy.stats has them too, but takes half a second to import.
"""

from typing import Any

import numpy as np
from scipy.special import gammaincc, gammainccinv, gammaincinv


def chi_squared(probability: float, numbers: int | np.ndarray) -> Any:
    """Quantile of chi-squared with `numbers` degrees of freedom; an array for arrays."""
    return 2 * gammaincinv(np.asarray(numbers) / 2, probability)


def chi_squared_beyond(probability: float | np.ndarray, numbers: int | np.ndarray) -> Any:
    """Value that chi-squared exceeds with a probability, precise for tiny probabilities too."""
    return 2 * gammainccinv(np.asarray(numbers) / 2, probability)


def beyond_sigmas(sigmas: float, numbers: int) -> float:
    """Value that chi-squared exceeds with the probability of a normal deviate beyond `sigmas` standard deviations."""
    return float(chi_squared_beyond(gammaincc(0.5, sigmas**2 / 2), numbers))
