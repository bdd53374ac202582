"""CSV files of priors: their conventions in numbers that tell every axis and sign, what is refused, and series."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.readers.instruments import COLUMNS, SIGMA_COLUMNS, poses_of, sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, Mount, NavigationSettings, parse_columns
from sonarmap.tools.files.writers.tables import write_priors
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import read as read_log
from tests.tools.files.readers.navigation.logs import require_words, scans_at

POINTS = np.ones((1, 3), np.float32)
SCANS = tuple(Scan(POINTS, stamp=100.0 + 10 * k, name=name) for k, name in enumerate(("first", "rec#3", "a.ply")))
FIRST = "name,heading_deg,heading_sigma_deg,depth_m,depth_sigma_m\n"
ATTITUDE = "roll_deg,pitch_deg,roll_sigma_deg,pitch_sigma_deg"


def read(path: Path, text: str, settings: NavigationSettings = AS_IT_SAYS, **options: object) -> tuple[Scan, ...]:
    path.write_bytes(text.encode())
    return navigate(SCANS, path, settings, **options).scans


def told(scan: Scan) -> PosePrior:
    assert scan.prior is not None
    return scan.prior


def refused(path: Path, text: str, *words: str, **options: object) -> None:
    require_words(path, words, read, path, text, **options)


class TestConventions:
    def test_roll_pitch_and_heading_follow_the_aerospace_order(self) -> None:
        """The textbook's matrix of forward, right, down in North, East, Down, with both frames' axes changed."""
        roll, pitch, heading = np.deg2rad([11.0, -23.0, 137.0])
        (cr, cp, ch), (sr, sp, sh) = np.cos([roll, pitch, heading]), np.sin([roll, pitch, heading])
        R_ned_frd = np.array(
            [
                [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
                [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        R_enu_ned, R_frd_flu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
        T = poses_of(np.array([[11.0, -23.0, 137.0, 4.0, 5.0, 6.0]]))[0]
        np.testing.assert_allclose(T.rotation.as_matrix(), R_enu_ned @ R_ned_frd @ R_frd_flu, atol=1e-14)
        np.testing.assert_array_equal(T.translation, [4.0, 5.0, -6.0])


class TestRows:
    def test_a_row_is_a_prior(self, path: Path) -> None:
        heading = "depth_m,name,heading_deg,heading_sigma_deg,depth_sigma_m,x_m,y_m,x_sigma_m,y_sigma_m"
        scans = read(path, f"{heading},{ATTITUDE}\n12.5,first,270,3,0.2,7,-8,1.5,2.5,10,20,0.5,0.7\n")
        prior = told(scans[0])
        np.testing.assert_allclose(prior.sigmas, [*np.deg2rad([0.5, 0.7, 3]), 1.5, 2.5, 0.2])
        np.testing.assert_allclose(prior.T_world_sensor.translation, [7, -8, -12.5])
        expected = Rotation.from_euler("ZYX", [-180, -20, 10], degrees=True)
        assert (prior.T_world_sensor.rotation.inv() * expected).magnitude() < 1e-12
        assert [scan.prior for scan in scans[1:]] == [None, None]
        assert [scan.name for scan in scans] == [scan.name for scan in SCANS]

    def test_empty_cells_are_not_measured(self, path: Path) -> None:
        first, second, third = read(path, FIRST + "first,,,3,0.1\nrec#3,45,2,,\na.ply,,,,\n")
        np.testing.assert_array_equal(np.isfinite(told(first).sigmas), [0, 0, 0, 0, 0, 1])
        np.testing.assert_array_equal(np.isfinite(told(second).sigmas), [0, 0, 1, 0, 0, 0])
        assert third.prior is None

    @pytest.mark.parametrize(
        ("names", "scan"),
        [
            (["first", "first.ply", "first.PCD", " first "], 0),
            (["rec#3", "rec.sonar#3"], 1),
            (["a.ply", "a.ply.ply"], 2),  # one that looks like a file is taken as it is first
        ],
    )
    def test_names_match_with_and_without_suffix(self, path: Path, names: list[str], scan: int) -> None:
        for name in names:
            assert told(read(path, FIRST + f"{name},1,1,1,1\n")[scan]).knows_heading

    def test_rows_match_by_stamp_unless_there_are_names(self, path: Path) -> None:
        scans = read(path, "stamp,depth_m,depth_sigma_m\n120.0004,3,0.1\n1e2,4,0.1\n")
        assert [scan.prior and -scan.prior.T_world_sensor.translation[2] for scan in scans] == [4, None, 3]
        notes: list[str] = []  # as in a template; nothing has to be said of it
        scans = read(path, "name,stamp,depth_m,depth_sigma_m\nfirst,100,1.5,0.1\nrec#3,7,,\n", notes=notes)
        assert [scan.prior is None for scan in scans] == [False, True, True]
        assert not notes

    def test_default_sigmas_are_used_where_the_file_has_none(self, path: Path) -> None:
        text = "name,depth_m,x_m,y_m,x_sigma_m,y_sigma_m\nfirst,1,2,3,7,8\nrec#3,1,2,3,,9\n"
        first, second, _ = read(
            path, text, NavigationSettings(sigmas={"depth_m": 0.3, "x_m": 5.0, "y_m": 6.0, "roll_deg": 1.0})
        )
        np.testing.assert_array_equal(told(first).sigmas, [np.inf, np.inf, np.inf, 7, 8, 0.3])
        np.testing.assert_array_equal(told(second).sigmas, [np.inf, np.inf, np.inf, 5, 9, 0.3])

    def test_rows_of_unknown_scans_are_ignored_if_allowed(self, path: Path) -> None:
        scans = read(path, FIRST + "else,1,1,1,1\nfirst,1,1,1,1\n", allow_unknown=True)
        assert [scan.prior is None for scan in scans] == [False, True, True]
        refused(path, FIRST + "else,1,1,1,1\n", "no row belongs to any of the scans", "'first'", allow_unknown=True)


HEADINGS = (
    ("name,hedding_deg", "unknown column 'hedding_deg'", "heading_deg"),
    ("depth_m,depth_sigma_m", "either a column name or a column stamp"),
    ("File,Time,depth_m,depth_sigma_m", "either a column name or a column stamp", "'File' and 'Time'"),
    ("name,roll_deg,roll_sigma_deg", "roll_deg and pitch_deg", "both or neither"),
    ("name,y_m,y_sigma_m", "x_m and y_m", "both or neither"),
    ("name,depth_m", "depth_m has no standard deviation", "depth_sigma_m", "--prior-sigmas"),
    ("name,depth_m,depth_sigma_m,heading_sigma_deg", "heading_sigma_deg but no heading_deg"),
)
ROWS = (
    ("first,1,1,1", "4 cells, the heading 5"),
    ("first,north,1,1,1", "heading_deg is 'north'", "empty cell"),
    ("first,1,1,-inf,1", "depth_m is '-inf'"),
    ("first,1,0,1,1", "heading_sigma_deg is 0", "above 0"),
    ("first,1,,1,1", "heading_deg has no standard deviation", "fill in heading_sigma_deg"),
    ("first,361,1,1,1", "heading_deg is 361", "within 360"),
    ("frist,1,1,1,1", "no scan has the name 'frist'", "'first'", "delete the line"),
    ('"first,1,1,1,1', "CSV"),
)
OTHERS = (
    (f"name,{ATTITUDE}\nfirst,1,,1,1\n", "line 2", "one of roll_deg and pitch_deg is empty"),
    ("stamp,depth_m,depth_sigma_m\n9000.5,1,1\n", "no row is at the time of a scan", "9000.500", "one clock"),
    (FIRST, "no row below its heading"),
    (f"{FIRST}rec#3,1,1,1,1\nfirst,1,1", "line 3", "3 cells", "may have been cut"),
    *((f"name,{column}\nfirst,1\n", "line 1", column, "give both") for column in ("lat", "lon_deg", "LON")),
)


class TestRefusals:
    @pytest.mark.parametrize(
        "case",
        [
            *((f"# told\n{header}\nfirst\n", "line 2", *words) for header, *words in HEADINGS),
            *((f"{FIRST}rec#3,1,1,1,1\n{row}\n", "line 3", *words) for row, *words in ROWS),
            *OTHERS,
        ],
    )
    def test_invalid_headings_and_rows_are_refused_with_their_line(self, path: Path, case: tuple[str, ...]) -> None:
        refused(path, *case)

    @pytest.mark.parametrize(("one", "other"), [("first", "first"), ("first", "first.ply"), ("a.ply", "a.ply.ply")])
    def test_two_rows_for_one_scan_are_refused(self, path: Path, one: str, other: str) -> None:
        refused(path, FIRST + f"{one},1,1,1,1\nrec#3,1,1,1,1\n{other},1,1,1,1\n", "lines 2 and 4", "delete one")

    def test_a_row_that_fits_two_scans_is_refused(self, path: Path) -> None:
        path.write_text("stamp,depth_m,depth_sigma_m\n0,1,1\n")
        scans = (Scan(POINTS, name="a"), Scan(POINTS, name="b"))
        refuses("line 2: the stamp '0' fits 2 scans, among them a and b", navigate, scans, path)


class TestOffices:
    def test_a_last_line_without_a_break_is_read_and_noted(self, path: Path) -> None:
        notes: list[str] = []
        assert read(path, FIRST + "first,12.5,1.5,-3.25,0.1", notes=notes)[0].prior is not None
        (note,) = notes
        assert "no line break" in note


def test_written_priors_are_read_back(path: Path) -> None:
    rng = np.random.default_rng(2)
    T = RigidTransform.from_components(rng.normal(size=(3, 3)), Rotation.random(3, rng=rng))
    sigmas = rng.uniform(0.1, 1, (3, 6))
    sigmas[0, :2], sigmas[1, 2], sigmas[2, 5] = np.inf, np.inf, np.inf
    priors = [PosePrior(T[k], sigmas[k]) for k in range(3)]
    write_priors(path, ["first.ply", "rec.sonar#3", "a.ply"], priors)
    for prior, scan in zip(priors, navigate(SCANS, path).scans, strict=True):
        np.testing.assert_allclose(told(scan).sigmas, prior.sigmas, rtol=1e-5)
        values, back = (values_of(one.T_world_sensor) for one in (prior, told(scan)))
        known = np.isfinite(prior.sigmas)
        np.testing.assert_allclose(back[known], values[known], atol=1e-6)
    assert path.read_text().splitlines()[0] == ",".join(("name", *COLUMNS, *SIGMA_COLUMNS))


SERIES = "stamp,heading_deg,heading_sigma_deg,x_m,y_m,x_sigma_m,y_sigma_m,depth_m,depth_sigma_m\n"


def interpolated(folder: Path, rows: str, *stamps: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and sigmas in the columns' units, (N, 6) each; NaN where a scan has no prior."""
    values, navigated, _ = read_log(folder / "nav.csv", SERIES + rows, scans=scans_at(*stamps))
    priors = [scan.prior for scan in navigated.scans]
    return values, np.array([np.full(6, np.nan) if prior is None else sigmas_of(prior) for prior in priors])


def test_values_between_rows_are_interpolated(tmp_path: Path) -> None:
    values, sigmas = interpolated(tmp_path, "0,350,2,10,0,1,1,3,0.1\n4,10,3,18,4,2,2,5,0.1\n", 1.0, 3.0)
    np.testing.assert_allclose(values[:, 2], [355, 5])  # through North
    np.testing.assert_allclose(values[:, 3:], [[12, 1, 3.5], [16, 3, 4.5]])
    np.testing.assert_allclose(sigmas[:, 2:], [[3, 2, 2, 0.1]] * 2)


def test_each_instrument_is_interpolated_between_its_own_times(tmp_path: Path) -> None:
    rows = "0.1,,,,,,,2,0.1\n0.6,90,1,,,,,,\n1.1,,,,,,,4,0.1\n1.6,100,1,,,,,,\n0.9,,,7,8,1,1,,\n"
    values, _ = interpolated(tmp_path, rows, 0.6001, 1.0, 30.0)
    np.testing.assert_allclose(values[0, [2, 5]], [90, 3], atol=0.01)
    np.testing.assert_allclose(values[1, 2:], [94, 7, 8, 3.8])
    assert np.isnan(values[2]).all()


def test_a_single_fix_belongs_to_the_nearest_scan(tmp_path: Path) -> None:
    rows = "10.2,,,5,6,1,1,,\n40.3,,,7,8,1,1,,\n77.7,90,1,,,,,,\n99,90,1,,,,,,\n"
    values, sigmas = interpolated(tmp_path, rows, *np.arange(0.0, 100.0, 1.0))
    fixed = np.flatnonzero(np.isfinite(values[:, 3]))
    np.testing.assert_array_equal(fixed, [10, 40])
    np.testing.assert_allclose(sigmas[10, 3:5], np.hypot(1, 0.2))
    # a heading does not hold for half a second, and no row is nearer than 5 s to the next
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(values[:, 2])), [99])


def test_rows_at_the_stamps_of_scans_are_not_interpolated(tmp_path: Path) -> None:
    """One row whose stamp is wrong is interpolated, as it was."""
    rows = "0,90,1,,,,,,\n1.5,91,1,,,,,,\n2,92,1,,,,,,\n"
    refuses(r"line 3: no scan has the stamp '1\.5'", interpolated, tmp_path, rows, 0.0, 1.0, 2.0)


@pytest.mark.parametrize("first", [-30, 0])
@pytest.mark.parametrize("every", [1.0, 2.0])
@pytest.mark.parametrize("late", [0.0, 0.1])
def test_a_log_at_the_scans_times_is_interpolated_too(first: int, every: float, late: float, tmp_path: Path) -> None:
    """A row per second says the same at the scans' times and beside them, from before the dive on or during it."""
    rows = "".join(f"{t + late:g},,,,,,,{20 + 0.1 * np.sin(t):.3f},0.1\n" for t in range(first, 41))
    stamps = np.arange(0.0, 40.0, every)
    values, navigated, notes = read_log(tmp_path / "nav.csv", SERIES + rows, scans=scans_at(*stamps))
    expected = 20 + 0.1 * np.sin(stamps - late)
    measured = np.isfinite(values[:, 5])
    assert measured[1:].all()
    np.testing.assert_allclose(values[measured, 5], expected[measured], atol=0.03)
    assert all(scan.prior is not None for scan in navigated.scans[1:])
    assert any("it was interpolated to those of the scans" in note for note in notes)


class TestSeveralFiles:
    ATTITUDE = f"name,{ATTITUDE}\nfirst,1,2,0.5,0.5\na.ply,3,4,0.5,0.5\n"  # for some of the scans
    DEPTH = "Time [s],Depth [m],Depth SD [m]\n" + "".join(f"{95 + 2 * k},{k},0.1\n" for k in range(20))
    PLACES = "stamp,Latitude,Longitude,lat_sigma_m,lon_sigma_m\n100,60,5,1,1\n110,60.001,5,1,1\n120,60.002,5,1,1\n"

    def written(self, folder: Path, *texts: str) -> list[Path]:
        for k, text in enumerate(texts):
            (folder / f"log{k}.csv").write_text(text)
        return [folder / f"log{k}.csv" for k in range(len(texts))]

    @pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
    def test_each_kind_is_taken_from_the_file_that_has_it(self, tmp_path: Path, order: tuple[int, ...]) -> None:
        paths = self.written(tmp_path, self.ATTITUDE, self.DEPTH, self.PLACES)
        mount = Mount.of(np.zeros(3), np.array([0.0, 0.0, 1.0]), up=False)
        navigated = navigate(SCANS, [paths[k] for k in order], NavigationSettings(mount=mount))
        assert navigated.georeference is not None
        first, second, third = map(told, navigated.scans)
        assert [prior.knows_attitude for prior in (first, second, third)] == [True, False, True]
        np.testing.assert_allclose(values_of(third.T_world_sensor)[:2], [3, 4], atol=1e-9)
        np.testing.assert_allclose(
            [values_of(prior.T_world_sensor)[5] for prior in (first, second)], [3.5, 8.5], atol=1e-3
        )
        north = [prior.T_world_sensor.translation[1] for prior in (second, third)]
        np.testing.assert_allclose(north, [111.42, 222.84], atol=0.2)

    @pytest.mark.parametrize(
        ("texts", "words"),
        [
            (
                (DEPTH, "name,depth_m,depth_sigma_m\na.ply,3,1\n"),
                "log0.csv and .*log1.csv both give depth_m of a",
            ),
            ((DEPTH, DEPTH), "both give depth_m of first"),
            ((PLACES, "name,x_m,y_m,x_sigma_m,y_sigma_m\na.ply,1,1,1,1\n"), "both give x_m of a"),
            (
                (PLACES.replace("100,60,5,1,1\n", ""), "name,x_m,y_m,x_sigma_m,y_sigma_m\nfirst,1,1,1,1\n"),
                "log0.csv has positions on the Earth, .*log1.csv has not; give --origin",
            ),
        ],
    )
    def test_contradictory_files_are_refused(self, tmp_path: Path, texts: tuple[str, ...], words: str) -> None:
        refuses(words, navigate, SCANS, self.written(tmp_path, *texts))

    def test_columns_mapped_for_one_file_do_not_affect_another(self, tmp_path: Path) -> None:
        paths = self.written(tmp_path, self.ATTITUDE, self.DEPTH.replace("Depth [m]", "KP"))
        navigated = navigate(SCANS, paths, NavigationSettings(columns=parse_columns("depth_m=KP")))
        assert told(navigated.scans[1]).knows_depth
