"""`sonarmap simulate`, and `--priors` end to end: simulated, written, read, and on the scans that are registered."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.prior import relative_prior
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.command.navigation import parse_prior_sigmas
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.poses.trajectory import read_tum
from sonarmap.tools.files.readers.scans import read_scans
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, instruments_for, measure_poses
from tests.samples.clutter_scans import files_in, refused, said, scan, sonarmap, table_of, write

SMALL = ("--scene", "harbor", "--scans", "3", "--sensor", "paper", "--spacing", "5", "--quiet")
NAV = "name,depth_m,heading_deg,heading_sigma_deg\n"
T_WORLD = RigidTransform.from_components(
    np.random.default_rng(3).uniform(-50, 50, (400, 3)),
    Rotation.from_euler("ZYX", np.random.default_rng(4).uniform([-3, -0.5, -0.5], [3, 0.5, 0.5], (400, 3))),
)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scans, their truth, and priors.csv."""
    folder = tmp_path_factory.mktemp("simulated")
    kinds = "attitude,heading, depth,position"
    assert sonarmap("simulate", *SMALL, "--seed", "9", "--priors", kinds, "-o", folder).exit_code == 0
    return folder


def errors_of(prior: PosePrior, T_true: RigidTransform) -> np.ndarray:
    """(6,) in PosePrior's order, to first order."""
    w = (T_true.rotation * prior.T_world_sensor.rotation.inv()).as_rotvec()
    _, _, z, cosine = prior.T_world_sensor.rotation.as_quat()
    level = Rotation.from_euler("Z", -2 * np.arctan2(z, cosine)).apply(w)
    return np.concatenate([level, T_true.translation - prior.T_world_sensor.translation])


class TestSimulated:
    def test_the_priors_of_the_file_are_about_the_truth(self, simulated: Path) -> None:
        """Within 4 of the default sigmas, as written for an operator and read again; and not the truth itself."""
        scans = navigate(read_scans([simulated]).scans, simulated / "priors.csv").scans
        truth = read_tum(simulated / "truth.tum").T_world_sensor
        assert len(scans) == 3
        for k, one in enumerate(scans):
            assert one.prior is not None
            np.testing.assert_allclose(one.prior.sigmas, [*np.deg2rad([0.5, 0.5, 3]), 3, 3, 0.1], rtol=1e-5)
            off = errors_of(one.prior, truth[k]) / one.prior.sigmas
            assert np.abs(off).max() < 4
            assert np.abs(off).min() > 1e-4
        relative = relative_prior(scans[0].prior, scans[2].prior)
        assert relative is not None
        T = truth[0].inv() * truth[2]
        assert relative.allows(T.rotation)
        assert relative.allows_shift(T.translation, T.rotation)
        assert not relative.allows(T.rotation * Rotation.from_euler("Z", 0.5))
        assert not relative.allows_shift(np.add(T.translation, [0, 0, 2.0]), T.rotation)

    def test_only_the_option_makes_a_difference_and_the_same_seed_none(self, simulated: Path, tmp_path: Path) -> None:
        for name, options in (("bare", ()), ("again", ("--priors", "all"))):
            assert sonarmap("simulate", *SMALL, "--seed", "9", *options, "-o", tmp_path / name).exit_code == 0
        bare, again, first = files_in(tmp_path / "bare"), files_in(tmp_path / "again"), files_in(simulated)
        assert again == first
        assert first.keys() - bare.keys() == {"priors.csv"}
        assert {name: first[name] for name in bare} == bare

    def test_only_what_was_asked_for_is_measured(self, simulated: Path, tmp_path: Path) -> None:
        assert sonarmap("simulate", *SMALL, "--seed", "9", "--priors", "depth", "-o", tmp_path).exit_code == 0
        rows, of_all = table_of(tmp_path / "priors.csv"), table_of(simulated / "priors.csv")
        assert list(rows[0]) == ["name", "depth_m", "depth_sigma_m"]
        assert [row["name"] for row in rows] == [f"scan_{k:03d}.ply" for k in range(3)]
        assert [row["depth_m"] for row in rows] == [row["depth_m"] for row in of_all]

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

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("instruments", [Instruments(), instruments_for(["attitude", "depth"])])
    def test_the_errors_have_the_deviations_they_are_said_to_have(self, instruments: Instruments) -> None:
        priors = measure_poses(T_WORLD, instruments, 5)
        known = np.isfinite(instruments.sigmas)
        turned = [T_WORLD[k] for k in range(400)]
        if not known[2]:  # then the heading is 0, and the errors are of the rest
            turned = [RigidTransform.from_rotation(heading_off(T.rotation)) * T for T in turned]
        off = np.array([errors_of(prior, T) for prior, T in zip(priors, turned, strict=True)])[:, known]
        np.testing.assert_allclose(off.std(axis=0) / instruments.sigmas[known], 1, atol=4 / np.sqrt(2 * 400))
        np.testing.assert_allclose(off.mean(axis=0) / instruments.sigmas[known], 0, atol=4 / np.sqrt(400))
        assert all((prior.sigmas == instruments.sigmas).all() for prior in priors)


def heading_off(R: Rotation) -> Rotation:
    """The turn about the vertical that takes the yaw away."""
    return Rotation.from_euler("Z", -R.as_euler("ZYX")[0])


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

    def test_a_file_of_priors_in_the_folder_is_no_scan(self, folder: Path) -> None:
        (folder / "nav.csv").rename(folder / "priors.csv")
        for paths in ([folder], [str(folder / "*")]):
            assert [one.name for one in read_scans(paths).scans] == ["scan_0", "scan_1", "scan_2"]


ONE = ("--scans", "1", "--quiet", "-o")


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


def described(folder: Path) -> dict:
    return json.loads((folder / "description.json").read_text())


@pytest.mark.slow
def test_the_noise_of_the_echoes_is_described_and_given_again(tmp_path: Path) -> None:
    values = ("noise.ghosts=0.2", "noise.speckle=0.6", "noise.lobe=1.5", "sensor.threshold=0.01")
    options = [word for value in values for word in ("--set", value)]
    assert sonarmap("simulate", "--seed", "4", *options, *ONE, tmp_path / "a").exit_code == 0
    settings = described(tmp_path / "a")["settings"]
    assert (settings["noise"]["ghosts"], settings["noise"]["speckle"], settings["noise"]["lobe"]) == (0.2, 0.6, 1.5)
    assert (settings["sensor"]["name"], settings["sensor"]["threshold"]) == ("eclipse", 0.01)
    again = ("--like", tmp_path / "a" / "description.json", "--quiet", "-o", tmp_path / "b")
    assert sonarmap("simulate", *again).exit_code == 0
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")


@pytest.mark.slow
def test_a_lower_threshold_leaves_more_points_of_the_same_scan(tmp_path: Path) -> None:
    assert sonarmap("simulate", "--seed", "4", *ONE, tmp_path / "a").exit_code == 0
    like = ("--like", tmp_path / "a" / "description.json")
    assert sonarmap("simulate", *like, "--set", "sensor.threshold=0", *ONE, tmp_path / "b").exit_code == 0
    few, many = (described(tmp_path / name)["scans"][0]["points"] for name in "ab")
    assert 1.2 * few < many < 2 * few


@pytest.mark.slow
def test_table_1_has_the_papers_noise_alone(tmp_path: Path) -> None:
    assert sonarmap("simulate", "--trajectory", "table1", *ONE, tmp_path / "out").exit_code == 0
    noise = described(tmp_path / "out")["settings"]["noise"]
    assert noise == {"sigma2": 1.0, "outliers": 0.0, "dropouts": 0.0, "ghosts": 0.0, "speckle": 0.0, "lobe": 0.0}
