"""Navigation from the command line: logs, their options, the template, simulated priors, and contradictions."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation import (
    ContradictedError,
    parse_prior_sigmas,
    refusing,
)
from sonarmap.tools.files.readers.instruments import poses_of, values_of
from sonarmap.tools.products.output.trial import MeasuredScans
from tests.samples.clutter_scans import done, files_in, refused, said, scan, sonarmap, table_of, write
from tests.samples.surveys import step_pair
from tests.tools.files.readers.navigation.test_contradictions import TIGHT, measured, path, priors, signed

SIGMAS = ("--prior-sigmas", "0.5,3,0.25,4")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three scans; beside them log.csv with a row for each by its number, and nav.csv with rows for two by name."""
    write(tmp_path, **{f"scan_{k}": scan(k) for k in range(3)})
    rows = "".join(f"{k + 37};{60.3913 + k * 1e-5:.6f};5,3221;KP{k};{2 * k}\n" for k in range(3)).replace(".", ",")
    (tmp_path / "log.csv").write_text("stamp;Lat;Lon;Note;KP_DEPTH\n" + rows)
    nav = "name,depth_m,heading_deg,heading_sigma_deg\nscan_0.ply,5,90,2\nscan_2,7,80,2\n"
    (tmp_path / "nav.csv").write_text(nav)
    return tmp_path


def write_table(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def test_options_define_how_a_log_is_read(folder: Path, seen: list[Scan]) -> None:
    options = ("--nav-columns", "depth_m=KP_DEPTH", "--nav-offset=-37", "--mount", "0,0,0,0,0,0.5", "--grid", "16")
    result = sonarmap("map", folder, "-o", folder / "out", "--priors", folder / "log.csv", *SIGMAS, *options)
    said(result, "enough", "not used: the columns 'Note'", "origin is the first fix, rounded: 60.39130, 5.32210")
    values = [values_of(one.prior.T_world_sensor) for one in seen if one.prior]
    np.testing.assert_allclose(np.array(values)[:, 5], [0.5, 2.5, 4.5])
    np.testing.assert_allclose(np.array(values)[:, 4], [0, 1.1142, 2.2284], atol=1e-3)


@pytest.mark.slow
def test_the_summary_holds_the_options_of_the_log(folder: Path) -> None:
    pair = (folder / "scan_0.ply", folder / "scan_2.ply")
    (folder / "log.csv").write_text("File;Lat;Lon;Heading\nscan_0;60.5;5.25;90\nscan_2;60.5;5.25;90\n")
    options = ("--priors", folder / "log.csv", *SIGMAS, "--heading-reference", "grid", "--nav-crs", "EPSG:32632")
    result = sonarmap("map", *pair, "-o", folder / "out", *options, "--grid", "64")
    said(result, "--nav-crs has no effect without columns of easting and northing")
    assert sonarmap("map", *pair, "-o", folder / "out", *options[:-2], "--grid", "64").exit_code in (0, 3)
    summary = json.loads((folder / "out" / "summary.json").read_text())
    settings, place = summary["settings"], summary["georeference"]
    assert (settings["heading_reference"], settings["priors"]) == ("grid", str(folder / "log.csv"))
    assert settings["prior_sigmas"] == SIGMAS[1]  # so that the same command can be given again
    assert "mount" not in settings
    assert (place["latitude"], place["longitude"]) == (60.5, 5.25)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--nav-frame", "xyz"), ["--nav-frame is 'xyz'", "frd, ned, flu, enu"]),
        (("--heading-reference", "magnetic"), ["--magnetic-declination DEG"]),
        (("--mount", "1,2"), ["--mount is '1,2'", "--mount 0,-30,0"]),
    ],
)
def test_invalid_options_are_refused(folder: Path, options: tuple[str, ...], words: list[str]) -> None:
    refused(sonarmap("map", folder, "-o", folder / "out", "--priors", folder / "log.csv", *SIGMAS, *options), *words)
    pair = (folder / "scan_0.ply", folder / "scan_1.ply")
    said(sonarmap("register", *pair, "--priors", folder / "log.csv", *SIGMAS, *options), words[0])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("map scans -o out --nav-frame enu", "--nav-frame has no effect without a file of navigation"),
        ("map scans -o out --odometry-drift 1,10", "--odometry-drift has no effect without --odometry"),
        ("register scans/a.ply scans/b.ply --prior-sigmas 1,1,1,1", "--prior-sigmas has no effect without --priors"),
        ("simulate -o out --fix-every 3", "no effect without --priors position"),
        ("simulate -o out --like description.json --scene harbor --seed 9", "leave out --scene, --seed"),
        ("simulate -o out --trajectory table1 --sensor sonar3d15", "--sensor has no effect with --trajectory table1"),
        ("simulate -o out --scans 1 --quiet --set noise.ghosts=1", "ghosts is"),
    ],
)
def test_invalid_and_unused_options_are_refused(
    tmp_path: Path, line: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "scans", a=scan(0), b=scan(1))
    refused(sonarmap(*line.split()), words)
    assert not (tmp_path / "out").exists()


def test_a_template_is_filled_in_and_used(folder: Path, seen: list[Scan]) -> None:
    (folder / "log.csv").unlink()
    template = folder / "priors.csv"
    said(done(sonarmap("inspect", folder, "--template", template)), f"written to {template}: 3 rows")
    rows = table_of(template)
    assert [row["name"] for row in rows] == ["scan_0", "scan_1", "scan_2"]
    assert all(row["heading_deg"] == row["depth_sigma_m"] == "" for row in rows)
    rows[1]["depth_m"] = "7.5"
    write_table(template, rows)
    sonarmap("map", folder, "-o", folder / "out", "--priors", template, *SIGMAS, "--grid", "16")
    assert [one.prior and float(one.prior.T_world_sensor.translation[2]) for one in seen] == [None, -7.5, None]
    refused(sonarmap("inspect", folder, "--template", template), "exists already")
    refused(sonarmap("inspect", template, "--template", folder / "b.csv"), "is a log of navigation")


SMALL = ("--scene", "harbor", "--scans", "3", "--sensor", "paper", "--spacing", "5", "--quiet")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scans, their truth, and priors.csv."""
    folder = tmp_path_factory.mktemp("simulated")
    kinds = "attitude,heading, depth,position"
    assert sonarmap("simulate", *SMALL, "--seed", "9", "--priors", kinds, "-o", folder).exit_code == 0
    return folder


class TestSimulated:
    def test_priors_add_only_priors_csv_and_the_seed_fixes_all_files(self, simulated: Path, tmp_path: Path) -> None:
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

    def test_priors_of_other_scans_in_the_folder_are_refused(self, simulated: Path, tmp_path: Path) -> None:
        (tmp_path / "priors.csv").write_bytes((simulated / "priors.csv").read_bytes())
        result = sonarmap("simulate", *SMALL, "--seed", "8", "-o", tmp_path)
        refused(result, "priors.csv, which does not belong to these scans", "remove it")
        assert files_in(tmp_path).keys() == {"priors.csv"}


class TestVerbs:
    def test_map_reads_scans_with_priors(self, folder: Path, seen: list[Scan]) -> None:
        options = ("--priors", folder / "nav.csv", "--prior-sigmas", "0.5,3,0.25,4", "--grid", "16")
        result = sonarmap("map", folder, "-o", folder / "out", *options)
        said(result, "enough", "1 of 3 scans have no prior", "scan_1")
        assert [one.name for one in seen] == ["scan_0", "scan_1", "scan_2"]  # and nav.csv is none of them
        assert [one.prior and float(one.prior.T_world_sensor.translation[2]) for one in seen] == [-5, None, -7]
        first = seen[0].prior
        assert first is not None
        np.testing.assert_allclose(first.sigmas, [np.inf, np.inf, np.deg2rad(2), np.inf, np.inf, 0.25])

    def test_register_reads_scans_with_priors(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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

    @pytest.mark.parametrize("text", ["1,2,3", "1,2,3,4,5", "1,2,3,0", "1,2,3,nan", "1,2,3,inf", "a,2,3,4", ""])
    def test_invalid_default_sigmas_are_refused(self, folder: Path, text: str) -> None:
        pair = (folder / "scan_0.ply", folder / "scan_1.ply")
        result = sonarmap("register", *pair, "--priors", folder / "nav.csv", "--prior-sigmas", text)
        refused(result, "four numbers above 0", "--prior-sigmas 0.5,3,0.1,3")

    def test_default_sigmas_are_in_the_order_of_the_help(self) -> None:
        sigmas = parse_prior_sigmas("1,2,3,4")
        assert sigmas == {"roll_deg": 1, "pitch_deg": 1, "heading_deg": 2, "depth_m": 3, "x_m": 4, "y_m": 4}


def scans_with(values: np.ndarray) -> list[Scan]:
    points = np.ones((1, 3), np.float32)
    return [Scan(points, stamp=k, prior=prior, name=f"s{k}") for k, prior in enumerate(priors(values))]


def free_pairs(truth: np.ndarray, numbers: Sequence[int]) -> list[RegisteredPair]:
    """Pairs of consecutive scans, registered without error."""
    poses = poses_of(truth)
    return [step_pair(k, poses[k].inv() * poses[k + 1], TIGHT) for k in numbers]


def test_a_heading_of_opposite_sign_is_named_and_refused() -> None:
    rng = np.random.default_rng(1)
    truth = path(rng, 60)
    values, free = measured(truth, rng), free_pairs(truth, range(0, 45, 3))
    right, wrong = (MeasuredScans(scans_with(each), "log.csv") for each in (values, signed(2)(values)))
    verdict = wrong.contradiction(free)
    assert verdict is not None
    assert verdict.instead == ("heading_deg with the opposite sign",)
    with pytest.raises(
        ContradictedError,
        match=r"they agree with heading_deg .*In log\.csv: give --correct-priors heading",
    ):
        refusing(wrong)(free)
    assert right.contradiction(free) is None
    refusing(right)(free)
    assert wrong.contradiction(free[:5]) is None
