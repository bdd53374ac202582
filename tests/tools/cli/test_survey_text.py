"""What the user is warned of after mapping, and what the table says of refused pairs."""

from dataclasses import replace

import numpy as np
import pytest

from slam.mapper import Mapper
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of
from tools.cli.text.pairs import print_pairs
from tools.output.faults import faults

NAMES = [f"scan{k}" for k in range(24)]


def told_of(covariance: np.ndarray) -> tuple[float, list[str]]:
    """By how much loops moved a pose [m], and what is said."""
    truth = ring_poses(24)
    survey = Mapper(KnowingRegistrar(truth, covariance), 0.5).run(scans_of(truth))
    return survey.moved, faults(survey, NAMES)


def test_loops_that_change_nothing_are_told() -> None:
    covariance = random_covariance(np.random.default_rng(0), 0.004, 0.03)
    moved, told = told_of(1e-8 * covariance)
    assert moved < 1e-4
    assert len(told) == 1
    assert "loops were kept, but no pose moved by more than 0.001 voxels" in told[0]
    moved, told = told_of(covariance)
    assert moved > 0.05
    assert told == []


def test_the_table_says_why_a_pair_was_refused(capsys: pytest.CaptureFixture[str]) -> None:
    truth = ring_poses(6, turns=0.3)

    def spoil(i: int, j: int, given):
        return replace(given, accepted=False, reason="too weak for this") if j - i > 1 else given

    registrar = KnowingRegistrar(truth, 1e-6 * np.eye(6), spoil)
    survey = Mapper(registrar, 0.5).run(scans_of(truth))
    print_pairs(survey, NAMES)
    printed = capsys.readouterr().out
    assert "chi-squared" in printed
    assert "degrees of freedom" in printed
    assert "sigmas: how far the pair is from the final poses" in printed
    assert any(not pair.kept for pair in survey.pairs)
    assert "too weak" in printed
