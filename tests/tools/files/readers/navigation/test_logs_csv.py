"""CSV logs: headings, units, what is not measured, what is ambiguous; texts of any length take a time in proportion."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.csv_table import degrees
from sonarmap.tools.files.readers.navigation.headings import column_of, zone_of
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings, parse_columns
from sonarmap.tools.files.readers.navigation.times import time_of_day
from tests.samples.processor_time import quick
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, require_words, scans_at


def refused(path: Path, text: str, *words: str, **settings: object) -> None:
    require_words(path, words, read, path, text, NavigationSettings(**settings))


def rows(*cells: str, separator: str = ",") -> str:
    """Three rows at the scans' times, 2 s before each."""
    return "".join(separator.join((f"{START + 5 * k - 2}", *cells)) + "\n" for k in range(4))


USUAL = {
    ("depth_m", 1): ["Depth (m)", "DEPTH", "Depth m", "Depth (m below surface)", "  Depth [ M ] "],
    ("depth_m", 0.01): ["Depth [cm]", "vehicle_depth.cm"],
    ("depth_m", 0.3048): ["ROV Depth (ft)"],
    ("heading_deg", 1): ["Heading [deg]", "Heading (°)", "HDG", "Heading (true)", "headingDeg"],
    ("magnetic_deg", 1): ["Heading (mag)", "Magnetic Heading"],
    ("yaw_deg", 180 / np.pi): ["yaw_rad"],
    ("roll_deg", 180 / np.pi): ["Roll (rad)"],
    ("lat_deg", 1): ["Lat", "Latitude [DD.DDDD]"],
    ("easting_m", 1): ["Easting (m)"],
    ("northing_m", 1): ["UTM_N"],
    ("x_m", 1): ["X"],
    ("stamp", 1): ["Date/Time", "UTC Time", "Time ( UTC+2 )"],
    ("stamp", 0.001): ["Timestamp [ms]"],
    ("depth_sigma_m", 1): ["Depth SD (m)"],
    ("heading_sigma_deg", 1): ["std_heading [deg]"],
    ("x_sigma_m", 0.01): ["Easting StdDev (cm)"],
}


UNUSED = ("Altitude", "COG", "Course", "Speed", "Height", "Status", "", "Temp (C)", "Depth_(below) (ft)", "depth_m)")


class TestHeadings:
    @pytest.mark.parametrize(
        ("heading", "quantity", "factor"),
        [(heading, quantity, factor) for (quantity, factor), headings in USUAL.items() for heading in headings],
    )
    def test_usual_headings_are_recognized(self, heading: str, quantity: str, factor: float) -> None:
        column = column_of(3, heading)
        assert column is not None
        assert (column.index, column.quantity) == (3, quantity)
        assert column.factor == pytest.approx(factor)

    def test_other_headings_are_not_guessed(self) -> None:
        assert [column_of(0, heading) for heading in UNUSED] == [None] * len(UNUSED)

    @pytest.mark.parametrize(
        ("heading", "words"), [("Depth (fathoms)", "fathoms"), ("Roll (m)", "'m'"), ("Easting (ft)", "international")]
    )
    def test_impossible_units_are_refused(self, heading: str, words: str) -> None:
        refuses(words, column_of, 0, heading)


class TestLogs:
    TEXT = "Timestamp,Hdg,Depth (m),Roll [deg],Pitch [deg],Batt\n" + rows("350.5", "12.25", "1.5", "-2.5", "98")
    WANTED = (1.5, -2.5, 350.5, np.nan, np.nan, 12.25)

    @pytest.mark.parametrize("separator", [",", ";", "\t"])
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
    @pytest.mark.parametrize("ending", ["\n", "\r\n"])
    @pytest.mark.parametrize("point", [".", ","])
    def test_every_dialect_is_read(self, path: Path, separator: str, encoding: str, ending: str, point: str) -> None:
        text = "# a comment\n\n" + self.TEXT.replace(",", separator) + separator * 5 + "\n"
        if separator != ",":
            text = text.replace(".", point)
        values, *_ = read(path, text.rstrip("\n").replace("\n", ending).encode(encoding))
        np.testing.assert_allclose(values, [self.WANTED] * 3)

    def test_columns_are_mapped(self, path: Path) -> None:
        text = 'Time,KP_DEPTH,Gyro [rad],Depth,"a, b",Roll (rad),Pitch\n' + rows("3.5", "1.5", "99", "4", "0.1", "-2")
        columns = parse_columns('depth_m=KP_DEPTH,heading_deg=gyro [rad],"depth_sigma_m=a, b"')
        values, navigated, _ = read(path, text, NavigationSettings(columns=columns))
        np.testing.assert_allclose(values[:, [0, 1, 2, 5]], [[np.degrees(0.1), -2, np.degrees(1.5), 3.5]] * 3)
        assert navigated.scans[0].prior is not None
        assert navigated.scans[0].prior.sigmas[5] == 4
        values, *_ = read(path, "Time,Alt\n" + rows("-7"), NavigationSettings(columns=parse_columns("height_m=Alt")))
        np.testing.assert_allclose(values[:, 5], 7)

    def test_roll_without_pitch_is_not_used(self, path: Path) -> None:
        values, _, notes = read(path, "Time,Depth,Roll\n" + rows("3", "9"))
        assert np.isnan(values[:, :2]).all()
        assert any("'Roll' is not used without a column of pitch_deg" in note for note in notes)

    def test_unknown_columns_are_ignored_only_beside_headings_of_a_log(self, path: Path) -> None:
        """With a log's heading among them others are left out, and a misspelled one is not."""
        values, *_ = read(path, "Time,depth_m,altitude_m\n" + rows("3", "9"))
        np.testing.assert_allclose(values[:, 5], 3)
        refused(path, "stamp,depth_m,altitude_m\n" + rows("3", "9"), "unknown column 'altitude_m'", "--nav-columns")
        refused(path, "Time,Depth,rol_deg,pitch_deg\n" + rows("3", "9", "1"), "misspelled roll_deg")


class TestFrames:
    """The same vehicle, nose up 10, starboard down 20, heading 30, at East 2, North 5, 7 deep."""

    WANTED = (20.0, 10.0, 30.0, 2.0, 5.0, 7.0)

    @pytest.mark.parametrize(
        ("frame", "heading", "cells"),
        [
            (None, "Time,Roll,Pitch,Heading,x,y,Depth", ("20", "10", "30", "2", "5", "7")),
            ("ned", "Time,Roll,Pitch,Yaw,x,y,z", ("20", "10", "30", "5", "2", "7")),
            ("frd", "Time,Roll,Pitch,Yaw,x,y,z", ("20", "10", "-330", "5", "2", "7")),
            ("enu", "Time,Roll,Pitch,Yaw,x,y,z", ("20", "-10", "60", "2", "5", "-7")),
            ("flu", "Time,Roll,Pitch,Heading,x,y,Depth", ("20", "-10", "30", "2", "5", "7")),
        ],
    )
    def test_frames_are_converted(self, path: Path, frame: str | None, heading: str, cells: tuple[str, ...]) -> None:
        values, *_ = read(path, f"{heading}\n{rows(*cells)}", NavigationSettings(frame=frame))
        np.testing.assert_allclose(values, [self.WANTED] * 3, atol=1e-9)

    def test_magnetic_headings_need_a_declination(self, path: Path) -> None:
        text = "Time,Magnetic Heading\n" + rows("358.5")
        values, *_ = read(path, text, NavigationSettings(declination=3.5))
        np.testing.assert_allclose(values[:, 2], 2)
        refused(path, text, "holds magnetic headings", "--magnetic-declination")
        refuses("--magnetic-declination", NavigationSettings, heading_reference="magnetic")

    def test_standard_deviations_are_exchanged_with_their_axes(self, path: Path) -> None:
        text = "Time,x,y,x std,y std\n" + rows("5", "2", "0.25", "0.75")
        _, navigated, _ = read(path, text, NavigationSettings(frame="ned"))
        prior = navigated.scans[0].prior
        assert prior is not None
        np.testing.assert_allclose(prior.sigmas[3:5], [0.75, 0.25])


class TestAmbiguous:
    @pytest.mark.parametrize(
        ("heading", "cells", "words"),
        [
            ("Time,Yaw", ("5",), ["'Yaw' may be clockwise", "--nav-frame ned", "--nav-frame enu"]),
            ("Time,Z", ("5",), ["'Z' may count downward", "--nav-frame ned"]),
            ("Time,Heading,HDG", ("5", "6"), ["both 'Heading' and 'HDG' may be heading_deg", "--nav-columns"]),
            ("GPSTime,Depth", ("5",), ["'GPSTime' may be GPS time or UTC", "--time-scale"]),
            ("Time,Easting,Northing", ("597000", "6643000"), ["reach 6643000 m", "--nav-crs"]),
            ("Time,Latitude,Longitude,x_m,y_m", ("1", "1", "1", "1"), ["x_m and y_m beside places", "--nav-columns"]),
            ("Time,Latitude,Depth", ("1", "1"), ["needs lon_deg"]),
        ],
    )
    def test_ambiguity_is_refused(self, path: Path, heading: str, cells: tuple[str, ...], words: list[str]) -> None:
        refused(path, f"{heading}\n{rows(*cells)}", *words)

    def test_degrees_in_columns_of_meters_are_refused(self, path: Path) -> None:
        cells = (f"{START + k},{5.32 + k / 1e3:.6f},{60.39 + k / 2e3:.6f}\n" for k in range(9))
        text = "stamp,x_m,y_m\n" + "".join(cells)
        refused(path, text, "x_m and y_m look like degrees", "Longitude and Latitude")
        values, *_ = read(path, text.replace("000\n", "\n").replace("000,", ","))
        assert np.isfinite(values[:2, 3:5]).all()  # in meters of few decimals

    def test_impossible_mappings_and_meters_in_columns_of_degrees_are_refused(self, path: Path) -> None:
        columns = parse_columns("x_m=Lon,y_m=Lat")
        refused(path, "Time,Lon,Lat\n" + rows("5", "60"), "'Lon' holds degrees", "lon_deg=Lon", columns=columns)
        refused(path, "Time,Depth\n" + rows("5"), "0 columns are 'Deep'", columns=parse_columns("depth_m=Deep"))
        text = "Time,Lat,Lon\n" + rows("6701000", "296000")
        refused(path, text, "Lon is 296000", "within 180", "easting_m=Lon", "--nav-crs")

    @pytest.mark.parametrize(
        ("text", "words"),
        [("depth_m", "not a mapping"), ("depht_m=a", "'depht_m' is not known"), ("depth_m=a,depth_m=b", "twice")],
    )
    def test_invalid_mappings_are_refused(self, text: str, words: str) -> None:
        refuses(words, parse_columns, text)

    def test_positions_given_twice_are_used_once(self, path: Path) -> None:
        text = "Time,Lat,Lon,Easting,Northing\n" + rows("60.4", "5.3", "296000", "6701000")
        values, navigated, notes = read(path, text)
        assert navigated.georeference is not None
        np.testing.assert_allclose(values[:, 3:5], 0, atol=1e-6)
        assert any("places are taken from Lat and Lon" in note for note in notes)


LONG = 100_000


@pytest.mark.parametrize(
    "read",
    [
        lambda: column_of(0, "a" + " " * LONG + "(" + " " * LONG + "x"),
        lambda: column_of(0, "a" + "_" * LONG + "." * LONG + "b "),
        lambda: zone_of("utc" + " " * LONG + "x"),
        lambda: degrees("1" + " " * LONG + "x", "lat_deg"),
        lambda: time_of_day("9:30" + " " * LONG + "x"),
    ],
)
def test_long_headings_and_cells_are_parsed_in_linear_time(read: Callable[[], object]) -> None:
    with quick():  # what takes a tenth of a second would take minutes, were it growing by squares
        read()


@pytest.mark.parametrize(
    "heading",
    [
        "Datum;Uhrzeit;Rollen [Grad];Stampfen [°];Kurs;Tiefe (m);Breite;Länge",
        "Datum;Zeit;Rollwinkel;Nickwinkel;Steuerkurs [°];Tiefe;Breitengrad;Laengengrad",
        "Date;Heure;Roulis [degrés];Tangage;Cap;Profondeur [m];Latitude;Longitude",
    ],
)
def test_headings_in_german_and_french_are_recognized(path: Path, heading: str) -> None:
    row = "01.07.2026;09:30:0{};1,5;-2;350,25;12,5;60,{};5,0"
    text = "\n".join([heading, *(row.format(2 * k, 1000 + k) for k in range(3)), ""])
    values, navigated, _ = read(path, text, scans=scans_at(START))
    np.testing.assert_allclose(values[0, [0, 1, 2, 5]], [1.5, -2, 350.25, 12.5], atol=1e-6)
    assert navigated.georeference is not None
    refuses("'Tidspunkt', 'Depth'; known are .*--nav-columns stamp=", read, path, "Tidspunkt;Depth\n1;2\n")


@pytest.mark.parametrize("cell", ["2026" + " " * LONG + "x", "T" * LONG])
def test_long_texts_of_times_are_refused_in_linear_time(cell: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"time,depth_m,depth_sigma_m\n{cell},2,3\n")
    words = r"line 2: the time is '.{1,45}'; wanted finite seconds, or a time as"
    with quick():
        refuses(words, read_navigation, tmp_path / "log.csv", AS_IT_SAYS, None, np.zeros(1), [])
