"""Scans, and logs of navigation, for the tests."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.instruments import COLUMNS, sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.priors import Navigated, navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings

START = 1782898200.0  # 2026-07-01 09:30:00 UTC
SIGMAS: dict[str, float] = dict.fromkeys(COLUMNS, 0.5)


def scans_at(*stamps: float) -> list[Scan]:
    """Scans of a point each."""
    return [Scan(np.ones((1, 3), np.float32), stamp=stamp, name=f"scan{k}") for k, stamp in enumerate(stamps)]


SCANS = scans_at(START, START + 5, START + 10)


def read(
    path: Path, text: str | bytes, settings: NavigationSettings = AS_IT_SAYS, scans: list[Scan] = SCANS
) -> tuple[np.ndarray, Navigated, list[str]]:
    """(N, 6) what a file says of the scans, in the order of COLUMNS, NaN where nothing; all that was read; notes."""
    notes: list[str] = []
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    navigated = navigate(scans, path, replace(settings, sigmas=SIGMAS), notes=notes)
    values = np.full((len(scans), 6), np.nan)
    for k, scan in enumerate(navigated.scans):
        if scan.prior is not None:
            known = np.isfinite(sigmas_of(scan.prior))
            values[k, known] = values_of(scan.prior.T_world_sensor)[known]
    return values, navigated, notes


def require_words(path: Path, words: Sequence[str], read: Callable[..., object], *given: Any, **options: Any) -> None:
    """That what is given is refused in these words, which name the file."""
    with pytest.raises(InputError) as error:
        read(*given, **options)
    missing = [word for word in (path.name, *words) if word not in str(error.value)]
    assert not missing, f"{missing} not in: {error.value}"
