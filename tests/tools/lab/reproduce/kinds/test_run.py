"""Pairs of every kind: which jobs there are, what is given and reported, and a run through the command line."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.kinds import run as module
from sonarmap.tools.lab.reproduce.kinds.navigation import directions
from sonarmap.tools.lab.reproduce.kinds.run import Kinds
from sonarmap.tools.lab.reproduce.kinds.settings import (
    LEVELED,
    NAVIGATION,
    NAVIGATION_OVERLAPS,
    KindsSettings,
)
from sonarmap.tools.lab.reproduce.methods import ComparedMethods
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from tests.tools.lab.reproduce.kinds.test_navigation import PAIR

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
    def test_a_simulated_pair_by_a_method_that_says_no_evidence(self) -> None:
        settings = KindsSettings(5, kinds=("sonar3d15",), seed=6, edge=32, compared=ComparedMethods(("planes",)))
        rows = Kinds(settings, None).run("sonar3d15/none/000/planes").rows
        assert [row["scene"] for row in rows] == list(SCAN_KINDS["sonar3d15"].scenes)
        assert not any(key.startswith("evidence") or "second" in key for row in rows for key in row)


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
