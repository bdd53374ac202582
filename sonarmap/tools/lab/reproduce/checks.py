"""Refusals of settings that several experiments have."""

from collections.abc import Sequence

import numpy as np

from sonarmap.kernels.errors import InputError


def check_seeds(seeds: int, first_seed: int) -> None:
    """Refuse less than one seed, and seeds below 0.

    Raises:
        InputError: saying what to give.
    """
    if seeds < 1 or first_seed < 0:
        raise InputError(
            f"{seeds} seeds from {first_seed} on; at least one is needed, and none below 0, as in --seeds 3 --seed 1"
        )


def check_variances(sigma2: Sequence[float]) -> None:
    """Refuse a list of variances [m^2] that is empty, or has one that is negative or not finite.

    Raises:
        InputError: saying what to give.
    """
    if not sigma2 or not all(np.isfinite(variance) and variance >= 0 for variance in sigma2):
        given = ", ".join(f"{variance:g}" for variance in sigma2) or "no value"
        raise InputError(f"--sigma2: {given}; variances must be 0 m^2 or more, as in --sigma2 1 --sigma2 2")
