"""Instruments on trial: by scans alone, and by free registrations; nothing is claimed of ordinary scans."""

from collections.abc import Callable

import numpy as np
import pytest

from sonarmap.slam.decide.systematic import Systematic
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.finding import Finding, Remedy
from sonarmap.tools.files.readers.instruments import poses_of
from sonarmap.tools.products.output.faults import scale_of, systematic_words
from sonarmap.tools.products.output.trial import Evidence, MeasuredScans, ScansOnTrial, on_trial
from tests.samples.surveys import step_pair
from tests.tools.files.readers.navigation.test_contradictions import TIGHT, measured, path, priors, signed

START = 1_782_898_200.0
EVEN = START + 0.2 * np.arange(100)
LOST = EVEN[np.random.default_rng(1).random(100) > 0.15]


def found_in(stamps: np.ndarray, points: Callable[[int], int] = lambda k: k, unread: int = 0) -> list[str]:
    """What is wrong with scans of these stamps; `points` gives the seed of each one's points."""
    trial = ScansOnTrial()
    for k, stamp in enumerate(stamps.tolist()):
        cloud = np.random.default_rng(points(k)).normal(0, 9, (60, 3)).astype(np.float32)
        trial.add(Scan(cloud, stamp=stamp, name=f"s{k}"), stamp)
    return [each.words for each in on_trial(Evidence(trial, unread))]


@pytest.mark.parametrize(
    "stamps",
    [
        EVEN,
        np.arange(100.0),  # numbered
        EVEN + np.random.default_rng(2).normal(0, 0.02, 100),
        START + np.cumsum(np.random.default_rng(3).uniform(0.1, 1.0, 100)),  # uneven
        np.concatenate([EVEN, EVEN + 300, EVEN + 700]),  # three lines
        EVEN[:3],
        np.delete(EVEN, [40, 60]),  # two of a hundred
        np.delete(EVEN, np.arange(60, 90, 2)),  # half of the rate for some time, as at a longer range
    ],
)
def test_nothing_is_claimed_of_ordinary_scans(stamps: np.ndarray) -> None:
    assert found_in(stamps) == []


def test_lost_scans_are_counted_by_their_times() -> None:
    (words,) = found_in(LOST)
    assert f"{100 - len(LOST)} of 100 scans" in words
    assert "missing by their times, 0.2 s apart otherwise" in words
    assert found_in(LOST, unread=100 - len(LOST)) == []  # they are in the files, and cannot be read


def test_a_clock_that_stands_still_or_is_set_back_is_named() -> None:
    (still,) = found_in(np.repeat(EVEN[:10], 5))
    assert still.startswith("the clock stands still: 40 of 49 stamps")
    (back,) = found_in(np.concatenate([EVEN[:50], EVEN[50:] - 3600]))
    assert back.startswith("1 of 99 stamps are not later than that of the shot before; set the sonar's clock by NTP")


def test_scans_that_repeat_are_counted() -> None:
    (words,) = found_in(EVEN, lambda k: min(k, 60) if k < 70 else k)
    assert words.startswith("9 of 100 scans repeat an earlier one point for point, the first s61")
    assert found_in(EVEN, lambda k: max(k, 1)) == []  # a single one


def test_surveys_have_clocks_of_their_own() -> None:
    trial = ScansOnTrial()
    for survey, stamps in enumerate((EVEN + 900, EVEN)):  # two dives, the later one first
        for k, stamp in enumerate(stamps.tolist()):
            points = np.random.default_rng([survey, k]).normal(0, 9, (60, 3)).astype(np.float32)
            trial.add(Scan(points, stamp=stamp), stamp, survey)
    assert on_trial(Evidence(trial)) == []


def test_a_unit_of_times_is_named() -> None:
    trial = ScansOnTrial()
    for k in range(10):
        trial.add(Scan(np.ones((60, 3), np.float32) * k), START + k, span=700.0)
    assert next(iter(trial.found())).words.startswith("the times of points are taken as milliseconds")


def test_a_contradiction_names_its_remedy() -> None:
    rng = np.random.default_rng(1)
    truth = path(rng, 60)
    poses, values = poses_of(truth), measured(truth, rng)
    free = [step_pair(k, poses[k].inv() * poses[k + 1], TIGHT) for k in range(0, 45, 3)]

    def found(values: np.ndarray, named: str = "log.csv") -> list[Finding]:
        scans = [Scan(np.ones((1, 3), np.float32), stamp=k, prior=prior) for k, prior in enumerate(priors(values))]
        return on_trial(Evidence(of_files=["a row is left out"], measured=MeasuredScans(scans, named), free=free))

    assert found(values) == [Finding("a row is left out")]
    _, (words, (remedy,)) = found(signed(5)(values))
    assert "depth_m with the opposite sign. In log.csv: give --correct-priors depth_m=-depth_m" in words
    assert remedy == Remedy("correct_priors", ("depth_m=-depth_m",))
    _, recorded = found(signed(5)(values), "")
    assert "In what recordings measured: give" in recorded.words
    assert not recorded.remedies  # there are no priors to correct


def test_a_wrong_speed_of_sound_names_the_factor() -> None:
    assert "ranges are too long, as with another speed of sound (--range-scale 0.952" in systematic_words(
        Systematic(longer=0.048)
    )
    either = Systematic(forward=1.0, alternative=Systematic(longer=0.048))
    assert scale_of(either) == scale_of(Systematic(longer=0.048)) == "0.952"
    assert scale_of(Systematic(forward=1.0)) == ""
