"""The patch test on simulated lines."""

import json

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.biases import Biases, corrected
from sonarmap.slam.pings.calibration import PatchTest, estimate_biases
from sonarmap.slam.pings.crossings import crossings
from sonarmap.slam.pings.line import PingLine
from tests.slam.pings.simulated_lines import WRONG, simulated


def surveyed(
    seed: int, truth: Biases = WRONG, *, lost: bool = False, rms: float = 0.5, pings: int = 240, beams: int = 80
) -> list[PingLine]:
    """Short lines as recorded, with navigation errors of a meter if `lost`."""
    constant, drift = ((1.0, 0.1), (0.15, 0.015)) if lost else ((0.0, 0.0), (0.0, 0.0))
    return simulated(seed, truth, rms, pings=pings, beams=beams, constant=constant, drift=drift).recorded


def sigmas(seen: PatchTest, truth: Biases) -> np.ndarray:
    """(4,) errors in standard deviations."""
    return (seen.biases.array - truth.array) / seen.deviations.array


class TestEstimate:
    @pytest.mark.slow
    def test_biases_are_those_of_the_recorder(self) -> None:
        lines = surveyed(1)
        seen = estimate_biases(lines, cell=1.5)
        assert seen.observable == ("latency", "roll", "pitch", "heading")
        assert (np.abs(sigmas(seen, WRONG)) < 3).all()
        assert (np.abs(seen.biases.array - WRONG.array) < [0.03, 0.0002, 0.006, 0.003]).all()
        assert seen.after < seen.before / 2
        assert seen.after == crossings([corrected(line, seen.usable) for line in lines], cell=1.5).all.p95
        assert json.loads(json.dumps(seen.to_json()))["observable"] == ["latency", "roll", "pitch", "heading"]

    def test_a_flat_bed_shows_only_roll(self) -> None:
        seen = estimate_biases(surveyed(3, rms=0.0, pings=100, beams=40))
        assert seen.observable == ("roll",)
        assert abs(seen.usable.roll - WRONG.roll) < np.radians(0.1)
        assert (seen.usable.latency, seen.usable.pitch, seen.usable.heading) == (0.0, 0.0, 0.0)
        assert (np.abs(sigmas(seen, WRONG)) < 3).all()

    def test_lines_apart_are_refused(self) -> None:
        lines = simulated(1, pings=50, beams=32).recorded
        with pytest.raises(InputError, match="needs two or more"):
            estimate_biases(lines[:1])
        with pytest.raises(InputError, match="overlap in 0 cells"):
            estimate_biases([lines[0], lines[4]])
        with pytest.raises(InputError, match="`mounting`"):
            estimate_biases(lines, mounting=Biases())


@pytest.mark.slow
@pytest.mark.parametrize("truth", [WRONG, Biases()], ids=["wrong", "right"])
def test_errors_are_as_large_as_stated(truth: Biases) -> None:
    """Over 10 surveys with navigation errors."""
    errors = np.array(
        [sigmas(estimate_biases(surveyed(k, truth, lost=True, pings=300, beams=128)), truth) for k in range(10)]
    )
    assert 0.7 < np.sqrt((errors**2).mean()) < 1.5
    assert (np.abs(errors) < 2).mean() > 0.88
    assert np.abs(errors).max() < 4
