"""`sonarmap simulate`, and `--priors` end to end: simulated, written, read, and on the scans that are registered."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation import parse_prior_sigmas
from tests.samples.clutter_scans import files_in, refused, said, scan, sonarmap, write

SMALL = ("--scene", "harbor", "--scans", "3", "--sensor", "paper", "--spacing", "5", "--quiet")
NAV = "name,depth_m,heading_deg,heading_sigma_deg\n"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scans, their truth, and priors.csv."""
    folder = tmp_path_factory.mktemp("simulated")
    kinds = "attitude,heading, depth,position"
    assert sonarmap("simulate", *SMALL, "--seed", "9", "--priors", kinds, "-o", folder).exit_code == 0
    return folder


class TestSimulated:
    def test_only_the_option_makes_a_difference_and_the_same_seed_none(self, simulated: Path, tmp_path: Path) -> None:
        for name, options in (("bare", ()), ("again", ("--priors", "all"))):
            assert sonarmap("simulate", *SMALL, "--seed", "9", *options, "-o", tmp_path / name).exit_code == 0
        bare, again, first = files_in(tmp_path / "bare"), files_in(tmp_path / "again"), files_in(simulated)
        assert again == first
        assert first.keys() - bare.keys() == {"priors.csv"}
        assert {name: first[name] for name in bare} == bare

    @pytest.mark.parametrize(("kinds", "words"), [("heading,sonar", "'sonar'"), ("", "''")])
    def test_unknown_instruments_are_refused(self, tmp_path: Path, kinds: str, words: str) -> None:
        result = sonarmap("simulate", *SMALL, "--priors", kinds, "-o", tmp_path / "out")
        refused(result, words, "attitude,heading,depth,position")
        assert not (tmp_path / "out").exists()

    def test_priors_of_other_scans_are_not_left_beside_these(self, simulated: Path, tmp_path: Path) -> None:
        (tmp_path / "priors.csv").write_bytes((simulated / "priors.csv").read_bytes())
        result = sonarmap("simulate", *SMALL, "--seed", "8", "-o", tmp_path)
        refused(result, "priors.csv, which does not belong to these scans", "remove it")
        assert files_in(tmp_path).keys() == {"priors.csv"}


class TestVerbs:
    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        """Three scans and nav.csv beside them, with a row for two of them."""
        write(tmp_path, **{f"scan_{k}": scan(k) for k in range(3)})
        (tmp_path / "nav.csv").write_text(NAV + "scan_0.ply,5,90,2\nscan_2,7,80,2\n")
        return tmp_path

    def test_a_map_is_made_of_scans_with_priors(self, folder: Path, seen: list[Scan]) -> None:
        options = ("--priors", folder / "nav.csv", "--prior-sigmas", "0.5,3,0.25,4", "--grid", "16")
        result = sonarmap("map", folder, "-o", folder / "out", *options)
        said(result, "enough", "1 of 3 scans have no prior", "scan_1")
        assert [one.name for one in seen] == ["scan_0", "scan_1", "scan_2"]  # and nav.csv is none of them
        assert [one.prior and float(one.prior.T_world_sensor.translation[2]) for one in seen] == [-5, None, -7]
        first = seen[0].prior
        assert first is not None
        np.testing.assert_allclose(first.sigmas, [np.inf, np.inf, np.deg2rad(2), np.inf, np.inf, 0.25])

    def test_two_scans_are_registered_with_priors(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        seen: list[Scan] = []

        def prepare(_: SpectralRegistrar, one: Scan) -> None:
            seen.append(one)
            if len(seen) == 2:
                raise InputError("enough")

        monkeypatch.setattr(SpectralRegistrar, "prepare", prepare)
        options = ("--priors", folder / "nav.csv", "--prior-sigmas", "0.5,3,0.25,4", "--grid", "16")
        result = sonarmap("register", folder / "scan_2.ply", folder / "scan_1.ply", *options)
        said(result, "enough", "1 of 2 scans have no prior")
        assert [one.prior and float(one.prior.T_world_sensor.translation[2]) for one in seen] == [-7, None]

    def test_a_map_wants_every_row_to_be_of_a_scan(self, folder: Path) -> None:
        (folder / "nav.csv").write_text(NAV + "scan_0,5,90,2\nscan_7,7,80,2\n")
        options = ("--priors", folder / "nav.csv", "--prior-sigmas", "1,1,1,1")
        refused(sonarmap("map", folder, "-o", folder / "out", *options), "nav.csv: line 3", "'scan_7'")
        assert not (folder / "out").exists()

    @pytest.mark.parametrize("text", ["1,2,3", "1,2,3,4,5", "1,2,3,0", "1,2,3,nan", "1,2,3,inf", "a,2,3,4", ""])
    def test_default_sigmas_that_will_not_do(self, folder: Path, text: str) -> None:
        pair = (folder / "scan_0.ply", folder / "scan_1.ply")
        result = sonarmap("register", *pair, "--priors", folder / "nav.csv", "--prior-sigmas", text)
        refused(result, "four numbers above 0", "--prior-sigmas 0.5,3,0.1,3")

    def test_default_sigmas_are_in_the_order_of_the_help(self) -> None:
        sigmas = parse_prior_sigmas("1,2,3,4")
        assert sigmas == {"roll_deg": 1, "pitch_deg": 1, "heading_deg": 2, "depth_m": 3, "x_m": 4, "y_m": 4}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--like description.json --scene harbor --seed 9", ["leave out --scene, --seed"]),
        ("--like description.json --sensor paper", ["leave out --sensor"]),
        ("--trajectory table1 --sensor sonar3d15", ["--sensor has no effect with --trajectory table1", "leave it out"]),
        ("--scans 1 --quiet --set noise.ghosts=1", ["ghosts is"]),
    ],
)
def test_what_would_not_be_heeded_or_cannot_be_is_refused(tmp_path: Path, options: str, words: list[str]) -> None:
    refused(sonarmap("simulate", *options.split(), "-o", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()
