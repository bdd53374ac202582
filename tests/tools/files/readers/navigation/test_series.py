"""Navigation at its own times, at the scans'."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.instruments import sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.priors import navigate
from tests.tools.files.readers.navigation.logs import scans_at

HEADING = "stamp,heading_deg,heading_sigma_deg,x_m,y_m,x_sigma_m,y_sigma_m,depth_m,depth_sigma_m\n"


def told(folder: Path, rows: str, *stamps: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and sigmas in the columns' units, (N, 6) each; NaN where a scan has no prior."""
    path = folder / "nav.csv"
    path.write_text(HEADING + rows)
    found = [scan.prior for scan in navigate(scans_at(*stamps), path).scans]
    nothing = np.full(6, np.nan)
    values = np.array([nothing if prior is None else values_of(prior.T_world_sensor) for prior in found])
    sigmas = np.array([nothing if prior is None else sigmas_of(prior) for prior in found])
    return np.where(np.isfinite(sigmas), values, np.nan), sigmas


def test_what_lies_between_rows_is_interpolated(tmp_path: Path) -> None:
    values, sigmas = told(tmp_path, "0,350,2,10,0,1,1,3,0.1\n4,10,3,18,4,2,2,5,0.1\n", 1.0, 3.0)
    np.testing.assert_allclose(values[:, 2], [355, 5])  # through North
    np.testing.assert_allclose(values[:, 3:], [[12, 1, 3.5], [16, 3, 4.5]])
    np.testing.assert_allclose(sigmas[:, 2:], [[3, 2, 2, 0.1]] * 2)


def test_every_instrument_has_times_of_its_own(tmp_path: Path) -> None:
    rows = "0.1,,,,,,,2,0.1\n0.6,90,1,,,,,,\n1.1,,,,,,,4,0.1\n1.6,100,1,,,,,,\n0.9,,,7,8,1,1,,\n"
    values, _ = told(tmp_path, rows, 0.6001, 1.0, 30.0)
    np.testing.assert_allclose(values[0, [2, 5]], [90, 3], atol=0.01)
    np.testing.assert_allclose(values[1, 2:], [94, 7, 8, 3.8])
    assert np.isnan(values[2]).all()


def test_a_single_fix_is_one_of_the_scan_next_to_it(tmp_path: Path) -> None:
    rows = "10.2,,,5,6,1,1,,\n40.3,,,7,8,1,1,,\n77.7,90,1,,,,,,\n99,90,1,,,,,,\n"
    values, sigmas = told(tmp_path, rows, *np.arange(0.0, 100.0, 1.0))
    fixed = np.flatnonzero(np.isfinite(values[:, 3]))
    np.testing.assert_array_equal(fixed, [10, 40])
    np.testing.assert_allclose(sigmas[10, 3:5], np.hypot(1, 0.2))
    # a heading does not hold for half a second, and no row is nearer than 5 s to the next
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(values[:, 2])), [99])


def test_rows_of_the_scans_themselves_are_no_series(tmp_path: Path) -> None:
    """One row whose stamp is wrong is told, as it was."""
    with pytest.raises(Exception, match=r"line 4: no scan has the stamp '2\.5'"):
        told(tmp_path, "0,90,1,,,,,,\n1,91,1,,,,,,\n2.5,92,1,,,,,,\n", 0.0, 1.0, 2.0)
