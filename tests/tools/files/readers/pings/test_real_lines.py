"""Real lines, where the folder of shared data lies beside the checkout, against what an independent reader found."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.pings.line_file import read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.places import DATA

pytestmark = pytest.mark.slow
FOLDER = DATA / "real" / "multibeam"


def real(name: str) -> RecordedLine:
    path: Path = FOLDER / name
    if not path.is_file():
        pytest.skip("shared/data/real/multibeam is not beside the checkout")
    return read_line(path, [])


def spread(points: np.ndarray, cell: float) -> float:
    """RMS of heights within cells with more than five [m]."""
    _, cells, counts = np.unique(np.floor(points[:, :2] / cell), axis=0, return_inverse=True, return_counts=True)
    cells = cells.ravel()
    squares = (points[:, 2] - (np.bincount(cells, points[:, 2]) / counts)[cells]) ** 2
    return float(np.sqrt(squares[counts[cells] > 5].mean()))


def track(line: RecordedLine) -> float:
    places = line.placed(line.origin()).places
    return float(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1).sum())


def test_a_harbor_by_an_r2sonic() -> None:
    line = real("r2sonic_harbour.xtf")
    points = line.placed(line.origin()).world_points()
    assert (len(line.stamps), line.beams, len(line.points)) == (923, 923 * 256, 236_288)
    assert track(line) == pytest.approx(32, abs=0.5)
    assert np.median(points[:, 2]) == pytest.approx(-10.5, abs=0.2)
    assert np.ptp(points, axis=0) == pytest.approx([36, 50, 2.7], abs=1.0)
    assert spread(points, 0.5) < 0.035
    # a wrong sign makes 8 cm and more of it
    fit = np.column_stack([points[:, :2], np.ones(len(points))])
    assert np.std(points[:, 2] - fit @ np.linalg.lstsq(fit, points[:, 2], rcond=None)[0]) < 0.11


def test_a_slope_by_an_em302() -> None:
    line = real("em302_slope.gsf")
    assert (len(line.stamps), line.beams, len(line.points)) == (50, 50 * 432, 20_959)
    assert np.ptp(line.stamps) == pytest.approx(298.5, abs=0.5)
    assert track(line) == pytest.approx(1250, abs=10)
    assert (line.points[:, 2].max(), line.points[:, 2].min()) == pytest.approx((-1166, -2317), abs=1)
    assert (*line.fixes[0, :2],) == pytest.approx((17.847, -64.597), abs=1e-3)
    assert (line.echo_sounder, line.sound_speed) == ("Kongsberg EM302", 1543.0)
    # as the sonar's own part of these pings says: 3.97 and 3.80 m
    assert line.sensors[[0, -1], 2] == pytest.approx([-3.97, -3.80], abs=0.15)
