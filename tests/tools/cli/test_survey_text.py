"""What the user is warned of after mapping, and what the table says of refused pairs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam.mapper import Mapper
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of
from tools.cli.text.survey import print_survey, warn_of_faults

NAMES = [f"scan{k}" for k in range(24)]


def warnings(patch: pytest.MonkeyPatch, covariance: np.ndarray, tmp_path: Path) -> tuple[float, list[str]]:
    """By how much loops moved a pose [m], and what was said."""
    truth = ring_poses(24)
    survey = Mapper(KnowingRegistrar(truth, covariance), 0.5).run(scans_of(truth))
    told: list[str] = []
    patch.setattr("tools.cli.text.survey.warn", told.append)
    warn_of_faults(survey, NAMES, tmp_path)
    return survey.moved, told


def test_loops_that_change_nothing_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    covariance = random_covariance(np.random.default_rng(0), 0.004, 0.03)
    moved, told = warnings(monkeypatch, 1e-8 * covariance, tmp_path)
    assert moved < 1e-4
    assert len(told) == 1
    assert "loops were kept, but no pose moved by more than 0.001 voxels" in told[0]
    moved, told = warnings(monkeypatch, covariance, tmp_path)
    assert moved > 0.05
    assert told == []


def test_the_table_says_why_a_pair_was_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    truth = ring_poses(6, turns=0.3)

    def spoil(i: int, j: int, given):
        return replace(given, accepted=False, reason="too weak for this") if j - i > 1 else given

    registrar = KnowingRegistrar(truth, 1e-6 * np.eye(6), spoil)
    survey = Mapper(registrar, 0.5).run(scans_of(truth))
    print_survey(survey, NAMES, tmp_path, ())
    printed = capsys.readouterr().out
    assert "chi-squared" in printed
    assert "degrees of freedom" in printed
    assert "sigmas: how far the pair is from the final poses" in printed
    assert any(not pair.kept for pair in survey.pairs)
    assert "too weak" in printed
