"""Pairs of every kind of scan: what is given and reported, and how its errors are counted."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.answer import refused
from sonarmap.tools.lab.reproduce.kinds import run as module
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import expected_error, usual_error
from sonarmap.tools.lab.reproduce.kinds.navigation import directions, navigation_cells, navigation_covariance
from sonarmap.tools.lab.reproduce.kinds.run import Kinds
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, NAVIGATION_OVERLAPS, PRIORS, KindsSettings
from sonarmap.tools.lab.reproduce.methods import ComparedMethods
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
        assert directions(row()) == []


TWO = KindsSettings(6, kinds=("swath", "patch"), compared=ComparedMethods(("spectral", "planes")))


@dataclass(frozen=True)
class Explained(Registration):
    """A registration that says what its probability was computed from."""

    evidence: tuple[tuple[str, float], ...] = (("p_psr", 21.0),)


@dataclass
class Fake:
    """Answers the identity, and keeps the scans that it gets."""

    given: list[Scan] = field(default_factory=list)

    def prepare(self, scan: Scan) -> Scan:
        self.given.append(scan)
        return scan

    def register(self, target: Scan, source: Scan) -> Registration:
        return Explained(RigidTransform.identity(), np.eye(6), 20.0, 0.5, True, 1.0)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    """In place of every method, with pairs in place of simulated ones; pair 3 is not there."""
    made = Fake()
    rng = np.random.default_rng(2)
    scans = [Scan(rng.uniform(-20, 20, (50, 3)).astype(np.float32)) for _ in range(2)]

    def kind_pair(kind: str, number: int, seed: int, overlaps: tuple[float, float] | None) -> KindPair:
        if number == 3:
            raise InputError("no such pair")
        shared = 0.5 if overlaps is None else overlaps[1]
        target, source = scans
        return replace(PAIR, kind=kind, number=number, seed=seed, target=target, source=source, shared=shared)

    monkeypatch.setattr(module, "registrar", lambda *_: made)
    monkeypatch.setattr(module, "kind_pair", kind_pair)
    return made


class TestRows:
    def test_what_is_known_is_given(self, fake: Fake) -> None:
        experiment = Kinds(TWO, None)
        for known, measured in (("none", None), (LEVELED, (True, False, False, True)), (NAVIGATION, (True,) * 4)):
            fake.given.clear()
            rows = experiment.run(f"swath/{known}/000/spectral").rows
            assert [row["number"] for row in rows] == [0, 1, 2, 4]
            assert len(fake.given) == 8
            for scan in fake.given:
                prior = scan.prior
                names = ("attitude", "heading", "position", "depth")
                assert (prior and tuple(getattr(prior, f"knows_{name}") for name in names)) == measured
            assert {row["shared"] for row in rows} == {NAVIGATION_OVERLAPS[1] if known == NAVIGATION else 0.5}
            assert all(bool(directions(row)) is (known == NAVIGATION) for row in rows)

    def test_cells(self, fake: Fake) -> None:
        row = Kinds(TWO, None).run("patch/none/001/spectral").rows[0]
        place = {"kind": "patch", "number": 5, "scene": "seabed", "relief": "weak", "priors": "none"}
        assert row.items() >= {**place, "method": "spectral"}.items()
        assert (row["right"], row["accepted"], row["psr"]) == (False, True, 20.0)
        length = np.linalg.norm(PAIR.T_target_source.translation)
        assert row["translation_m"] == pytest.approx(length)
        assert row["translation_voxels"] == pytest.approx(length / float(row["voxel_m"]))
        assert math.isfinite(float(row["nees"]))


@pytest.mark.slow
def test_a_quick_run_and_its_files(tmp_path: Path, device: Device) -> None:
    arguments = ["reproduce", "kinds", "--quick", "--seed", "6", "-q", "--method", "spectral", "--method", "planes"]
    arguments += ["-o", str(tmp_path / "out"), "--device", device.selector]
    shown = CliRunner().invoke(app, arguments)
    assert (shown.exit_code, shown.exception) == (0, None)
    page = (tmp_path / "out" / "kinds.md").read_text()
    assert page.startswith("# Every kind of scan\n")
    assert "\nsonarmap reproduce kinds --quick --seed 6 --method spectral --method planes\n" in page
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"kinds.png", "kinds-probability.png"}
    headings, *lines = (tmp_path / "out" / "kinds.csv").read_text().splitlines()
    assert headings.startswith("kind,number,scene,relief,shared,priors,method,voxel_m,right,")
    assert len(lines) == 5 * (2 * 3 + 1)


def row(**changes: object) -> dict:
    """A right, believed registration by ours with nothing known, but for what is said."""
    place = {"kind": "patch", "number": 1, "scene": "harbor", "relief": "rich", "shared": 0.5, "priors": "none"}
    answer = {"right": True, "accepted": True, "nees": 5.0, "probability": 0.95}
    return place | {"method": "spectral", "voxel_m": 1.0} | answer | changes


class TestCalibration:
    def test_the_expected_error_is_weighted_over_ten_bins(self) -> None:
        rows = [row(probability=p, right=r) for p, r in ((0.95, True), (0.91, False), (0.25, False), (1.0, True))]
        top = abs((0.95 + 0.91 + 1.0) / 3 - 2 / 3) * 3 / 4
        assert expected_error(rows) == pytest.approx(top + 0.25 / 4)
        assert math.isnan(expected_error([row(probability=math.nan)]))

    def test_what_an_exact_probability_leaves_shrinks_with_the_number_and_away_from_the_middle(self) -> None:
        def left(p: float, count: int) -> float:
            return usual_error([row(probability=p)] * count)

        for p in (0.5, 0.9):  # the mean of a normal deviation is 0.8 of its standard deviation
            assert left(p, 400) == pytest.approx(0.8 * math.sqrt(p * (1 - p) / 400), rel=0.06)
        assert left(0.0, 9) == left(1.0, 9) == 0.0
        assert usual_error([*[row(probability=0.55)] * 50, *[row(probability=0.45)] * 50]) > 1.3 * left(0.55, 100)
        assert math.isnan(usual_error([row(probability=math.nan)]))
