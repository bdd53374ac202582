"""Where the right pose is lost, stage by stage."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.evidence.pairs import EvidencePair, draw
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.funnel.run import Funnel
from sonarmap.tools.lab.reproduce.funnel.section import funnel_section
from sonarmap.tools.lab.reproduce.funnel.settings import KINDS, FunnelSettings, funnel_settings
from sonarmap.tools.lab.reproduce.funnel.traced import ROUNDS, TracingRegistrar

SEED = 6


@pytest.fixture(scope="module")
def pair() -> EvidencePair:
    """Two views of a sensor that stands still, on few voxels."""
    return next(draw("still", 0, SEED, 64))


def test_what_is_traced_is_what_is_registered(pair: EvidencePair) -> None:
    registrar = TracingRegistrar(choose_device(), pair.grid)
    prepared = registrar.prepare(pair.target), registrar.prepare(pair.source)
    registration = registrar.register(*prepared)
    assert pair.truth is not None
    assert pair_error(registration.T_target_source, pair.truth).rotation_deg < 3.0
    traced = registrar.trace(*prepared, pair.truth)
    assert traced["right_given_nothing"] == traced["right_given_pose"] == True  # noqa: E712
    assert traced["final"] == 0
    assert all(int(traced[stage]) >= 0 for stage in ("rotations", "candidates", *ROUNDS, "compared"))
    assert float(traced["rotation_deg"]) < 12.0
    # of another place nothing is found, though its rotation and then its pose are given: they do not win
    away = RigidTransform.from_components([300.0, 0.0, 0.0], Rotation.from_euler("z", 100, degrees=True)) * pair.truth
    lost = registrar.trace(*prepared, away)
    assert (lost["candidates"], lost["final"]) == (-1, -1)
    assert not any(lost[f"right_given_{given}"] for given in ("nothing", "rotation", "pose"))


@pytest.mark.slow
def test_a_true_rotation_that_is_given_is_followed(pair: EvidencePair, monkeypatch: pytest.MonkeyPatch) -> None:
    registrar = TracingRegistrar(choose_device(), pair.grid)
    prepared = registrar.prepare(pair.target), registrar.prepare(pair.source)
    rotations = TracingRegistrar._rotations

    def elsewhere(registrar: TracingRegistrar, *args: object) -> object:
        found = rotations(registrar, *args)  # pyright: ignore[reportArgumentType]
        return replace(found, R=Rotation.from_euler("z", 60, degrees=True) * found.R)

    monkeypatch.setattr(TracingRegistrar, "_rotations", elsewhere)
    assert pair.truth is not None
    traced = registrar.trace(*prepared, pair.truth)
    assert not traced["right_given_nothing"]
    assert traced["right_given_rotation"]
    assert traced["right_given_pose"]


def test_a_pair_without_candidates_counts_as_lost(pair: EvidencePair, monkeypatch: pytest.MonkeyPatch) -> None:
    registrar = TracingRegistrar(choose_device(), pair.grid)
    prepared = registrar.prepare(pair.target), registrar.prepare(pair.source)
    monkeypatch.setattr(Bounds, "allow_rotations", lambda _bounds, R: np.zeros(len(R), dtype=bool))
    assert pair.truth is not None
    traced = registrar.trace(*prepared, pair.truth)
    assert (traced["rotations"], traced["final"], traced["right_given_nothing"]) == (-1, -1, False)


@pytest.mark.slow
def test_every_kind_and_step_has_jobs_and_rows() -> None:
    experiment = Funnel(replace(funnel_settings(Request(quick=True)), seed=SEED), choose_device())
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
