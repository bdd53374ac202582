"""Where the right pose is lost, stage by stage."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.evidence.pairs import draw
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.funnel.run import create
from sonarmap.tools.lab.reproduce.funnel.section import funnel_section
from sonarmap.tools.lab.reproduce.funnel.settings import KINDS, FunnelSettings
from sonarmap.tools.lab.reproduce.funnel.traced import ROUNDS, TracingRegistrar

SEED = 6


Traced = tuple[TracingRegistrar, tuple[SpectralScan, SpectralScan], RigidTransform]


@pytest.fixture(scope="module")
def traced() -> Traced:
    """Two prepared views of a sensor that stands still, on few voxels, and the truth."""
    pair = next(draw("still", 0, SEED, 64))
    registrar = TracingRegistrar(choose_device(), pair.grid)
    assert pair.truth is not None
    return registrar, (registrar.prepare(pair.target), registrar.prepare(pair.source)), pair.truth


def test_what_is_traced_is_what_is_registered(traced: Traced) -> None:
    registrar, prepared, truth = traced
    registration = registrar.register(*prepared)
    assert pair_error(registration.T_target_source, truth).rotation_deg < 3.0
    ranks = registrar.trace(*prepared, truth)
    assert ranks["right_given_nothing"] == ranks["right_given_pose"] == True  # noqa: E712
    assert ranks["final"] == 0
    assert all(int(ranks[stage]) >= 0 for stage in ("rotations", "candidates", *ROUNDS, "compared"))
    assert float(ranks["rotation_deg"]) < 12.0
    # of another place nothing is found, though its rotation and then its pose are given: they do not win
    away = RigidTransform.from_components([300.0, 0.0, 0.0], Rotation.from_euler("z", 100, degrees=True)) * truth
    lost = registrar.trace(*prepared, away)
    assert (lost["candidates"], lost["final"]) == (-1, -1)
    assert not any(lost[f"right_given_{given}"] for given in ("nothing", "rotation", "pose"))


@pytest.mark.slow
def test_a_true_rotation_that_is_given_is_followed(traced: Traced, monkeypatch: pytest.MonkeyPatch) -> None:
    registrar, prepared, truth = traced
    rotations = TracingRegistrar._rotations

    def elsewhere(registrar: TracingRegistrar, *args: object) -> object:
        found = rotations(registrar, *args)  # pyright: ignore[reportArgumentType]
        return replace(found, R=Rotation.from_euler("z", 60, degrees=True) * found.R)

    monkeypatch.setattr(TracingRegistrar, "_rotations", elsewhere)
    ranks = registrar.trace(*prepared, truth)
    assert ranks["rotations"] == -1  # places that look alike may lead to the right pose without it
    assert ranks["right_given_rotation"]
    assert ranks["right_given_pose"]


def test_a_pair_without_candidates_counts_as_lost(traced: Traced, monkeypatch: pytest.MonkeyPatch) -> None:
    registrar, prepared, truth = traced
    monkeypatch.setattr(Bounds, "allow_rotations", lambda _bounds, R: np.zeros(len(R), dtype=bool))
    ranks = registrar.trace(*prepared, truth)
    assert (ranks["rotations"], ranks["final"], ranks["right_given_nothing"]) == (-1, -1, False)


@pytest.mark.slow
def test_every_kind_and_step_has_jobs_and_rows() -> None:
    experiment = create(Request(choose_device(), quick=True, seed=SEED))
    assert experiment.jobs() == sorted([*(f"{kind}-0000" for kind in KINDS), "S1.0-0000", "S2.0-0000", "S4.0-0000"])
    (row,) = experiment.run("still-0000").rows
    assert (row["set"], row["final"]) == ("still", 0)


def test_shares_are_counted_by_stage() -> None:
    ranks = dict.fromkeys(("rotations", "candidates", *ROUNDS, "compared", "final"), 0)
    right = {f"right_given_{given}": True for given in ("nothing", "rotation", "pose")}
    found = {"set": "swath", "relief": "rich"} | ranks | right
    lost = found | {"candidates": -1, **dict.fromkeys(ROUNDS, -1), "compared": -1, "final": -1}
    lost |= {"right_given_nothing": False, "right_given_rotation": False}
    beaten = found | {"final": 1, "right_given_nothing": False}
    rows = [found, lost, beaten, found, found | {"relief": "flat"}]
    _, table = funnel_section(rows, [], FunnelSettings()).tables
    (line,) = table.rows
    assert line[:4] == ("swath", "4", "100%", "75%")
    assert line[-5:] == ("75%", "50%", "50%", "75%", "100%")
