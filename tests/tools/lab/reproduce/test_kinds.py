"""Pairs of every kind of scan: what is given and reported, and how its errors are counted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.answer import refused
from sonarmap.tools.lab.reproduce.kinds.navigation import directions, navigation_cells, navigation_covariance
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION, PRIORS
from sonarmap.tools.lab.reproduce.kinds.tables import beside_others, method_table
from sonarmap.tools.lab.simulate.kinds.kind import KindPair

SCAN = Scan(np.zeros((1, 3), np.float32))
PAIR = KindPair(
    kind="swath",
    number=0,
    seed=1,
    scene="seabed",
    target=SCAN,
    source=SCAN,
    T_world_target=RigidTransform.from_components([5.0, -3.0, -8.0], Rotation.from_euler("ZYX", [2.0, 0.1, -0.05])),
    T_world_source=RigidTransform.from_components([25.0, 22.0, -7.0], Rotation.from_euler("ZYX", [-1.0, 0.02, 0.1])),
    shared=0.3,
)


def navigated(pair: KindPair) -> tuple[PosePrior, PosePrior]:
    """What navigation measures of both scans."""
    instruments = PRIORS[NAVIGATION]
    assert instruments is not None
    given = pair.with_priors(instruments)
    assert given.target.prior is not None
    assert given.source.prior is not None
    return given.target.prior, given.source.prior


def registration(error: np.ndarray, sigmas: np.ndarray) -> Registration:
    """Off by `error` and with standard deviations `sigmas`, both along the source's axes [m]."""
    T = PAIR.T_target_source * RigidTransform.from_translation(error)
    return Registration(T, np.diag(np.concatenate([np.full(3, 1e-6), sigmas**2])), 20.0, 0.3, True, 1.0)


class TestCells:
    def test_directions_are_those_of_the_covariance_in_the_targets_axes(self) -> None:
        priors = navigated(PAIR)
        error = np.array([0.3, -2.0, 0.1])
        answer = registration(error, np.array([0.5, 3.0, 0.02]))
        found = directions(navigation_cells(answer, PAIR.T_target_source, *priors))
        assert [direction.sigma for direction in found] == pytest.approx([0.02, 0.5, 3.0])
        assert [abs(direction.error) for direction in found] == pytest.approx([0.1, 0.3, 2.0], abs=1e-6)
        T = priors[0].T_world_sensor.inv() * priors[1].T_world_sensor
        off = T.translation - PAIR.T_target_source.translation
        lengths = [np.linalg.norm([direction.navigation_error for direction in found]), np.linalg.norm(off)]
        assert lengths[0] == pytest.approx(lengths[1])
        assert [direction.is_fixed for direction in found] == [True, True, False]

    def test_the_covariance_of_navigation_is_that_of_its_errors(self) -> None:
        """Roll, pitch and heading turn the way to the source; positions and depths err besides."""
        draws = []
        for number in range(100):
            target, source = navigated(replace(PAIR, number=number))
            off = (target.T_world_sensor.inv() * source.T_world_sensor).translation - PAIR.T_target_source.translation
            draws.append(off @ np.linalg.solve(navigation_covariance(target, source), off))
        assert np.mean(draws) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 100))

    def test_a_refused_registration_has_none(self) -> None:
        assert navigation_cells(refused("why"), PAIR.T_target_source, *navigated(PAIR)) == {}


@pytest.mark.slow
def test_a_quick_run_and_its_files(tmp_path: Path, device: Device) -> None:
    asked = ["kinds", "--quick", "--pairs", "2", "--seed", "6", "--method", "spectral", "--method", "planes"]
    arguments = ["reproduce", *asked, "-q", "-o", str(tmp_path / "out"), "--device", device.selector]
    shown = CliRunner().invoke(app, arguments)
    assert (shown.exit_code, shown.exception) == (0, None)
    page = (tmp_path / "out" / "kinds.md").read_text()
    assert page.startswith("# Every kind of scan\n")
    assert f"\nsonarmap reproduce {' '.join(asked)}\n" in page
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"kinds.png", "kinds-probability.png"}
    headings, *lines = (tmp_path / "out" / "kinds.csv").read_text().splitlines()
    assert headings.startswith("kind,number,scene,relief,shared,priors,method,voxel_m,right,")
    assert len(lines) == 2 * (2 * 3 + 1)


def row(**changes: object) -> dict:
    """A right, believed registration by ours with nothing known, but for what is said."""
    place = {"kind": "patch", "number": 1, "scene": "harbor", "relief": "rich", "shared": 0.5, "priors": "none"}
    answer = {"right": True, "accepted": True, "nees": 5.0, "probability": 0.95}
    return place | {"method": "spectral", "voxel_m": 1.0} | answer | changes


def test_the_worst_kind_is_named_beside_the_other_methods() -> None:
    swaths = [row(kind="swath", number=number, right=number < 6, accepted=number < 4) for number in range(8)]
    rows = [*(row(number=number) for number in range(10)), *swaths, row(method="planes", right=False)]
    shown, others, _ = {line[0]: line[1:] for line in beside_others(rows)}["right, known: nothing"]
    assert shown.startswith("16/18")
    assert "swath 75 %" in shown
    assert others == "best: planes 0 %"
    assert [line[0] for line in method_table(rows).rows] == ["swath", "patch", "all kinds"]
