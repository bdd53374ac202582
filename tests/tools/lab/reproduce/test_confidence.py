"""Recorded evidence, and the confidence that is fitted to it."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.covariance import SLIDE, fit_covariance
from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.reproduce.confidence import CLUES, fit_logistic, judged, reference
from sonarmap.tools.lab.reproduce.evidence import draw, recorded_pairs
from sonarmap.tools.lab.reproduce.experiments import Request, Row, create

SEED = 5


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """The rows of a few draws on few voxels."""
    experiment = create("confidence", Request(choose_device(), quick=True, seed=SEED))
    jobs = ["patch-0000", "sound_speed-0002", "unrelated-0000"]
    return [row for job in jobs for row in experiment.run(job).rows]


@pytest.mark.slow
def test_recorded_pairs_have_the_clues_of_their_registration(rows: list[Row]) -> None:
    pairs = recorded_pairs(rows)
    assert {pair.cells["set"] for pair in pairs} == {"patch", "sound_speed", "unrelated"}
    pair = next(pair for pair in draw("patch", 0, SEED, 64))
    registrar = SpectralRegistrar(choose_device(), pair.grid)
    registration = registrar.register(registrar.prepare(pair.target), registrar.prepare(pair.source))
    recorded = next(each for each in pairs if each.cells["set"] == "patch" and each.cells["known"] == "none")
    again = judged([recorded], SLIDE)
    np.testing.assert_allclose(again.clues[0], [dict(registration.evidence)[f"p_{name}"] for name in CLUES], atol=1e-6)
    covariance = fit_covariance(recorded.hypotheses[0], recorded.centers, recorded.grid, recorded.seen)
    np.testing.assert_allclose(covariance.posterior, registration.covariance, rtol=1e-6)
    assert again.fixed[0] == pytest.approx(registration.fixed, abs=1e-6)


@pytest.mark.slow
def test_the_fitted_table_has_the_layout_of_the_package(
    rows: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = create("confidence", Request(choose_device(), quick=True, seed=SEED))
    assert experiment.conclude is not None
    assert experiment.write is not None
    concluded = experiment.conclude(rows)
    whole = concluded[0]
    right, likely, accepted = (int(whole[name]) for name in ("right", "likely_right", "accepted_right"))
    assert right >= likely >= accepted >= 0
    monkeypatch.setattr("sonarmap.tools.lab.reproduce.confidence.TABLE", tmp_path / "fitted.json")
    assert "fitted.json" in experiment.write(concluded)
    written = json.loads((tmp_path / "fitted.json").read_text())
    assert set(written) == set(FITTED)
    assert list(written["probability"]["clues"]) == list(CLUES) == list(FITTED["probability"]["clues"])
    assert len(written["probability"]["weights"]) == len(FITTED["probability"]["weights"])
    assert written["made"]["pairs"] == whole["pairs"]


def test_the_fit_recovers_a_known_logistic() -> None:
    rng = np.random.default_rng(1)
    columns, share = rng.normal(size=(20_000, 3)), rng.uniform(0.3, 1.0, 20_000)
    right = rng.random(20_000) < share * expit(0.5 + columns @ [1.0, -2.0, 0.0])
    constant, weights = fit_logistic(columns, right, share)
    assert constant == pytest.approx(0.5, abs=0.12)
    np.testing.assert_allclose(weights, [1.0, -2.0, 0.0], atol=0.12)


@pytest.mark.slow
def test_the_fitted_table_is_up_to_date() -> None:
    """The reference pairs have the clues that they had when the table was written.

    If not: `sonarmap reproduce confidence -o OUT --write`.
    """
    found = reference(choose_device())
    assert found.keys() == FITTED["reference"].keys()
    for number, clues in found.items():
        assert clues == pytest.approx(FITTED["reference"][number], abs=0.05)
