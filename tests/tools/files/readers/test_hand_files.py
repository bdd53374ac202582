"""Files of ties and of control points: what they say, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.constraints import read_control, read_ties
from tests.samples.refusals import refuses

SCANS = [Scan(np.ones((1, 3), np.float32), stamp=float(k), name=f"dive{k}") for k in range(12)]
TRANSFORM = "target,source,verdict,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,sigma_m,sigma_deg,note\n"
TIE, CONTROL = "target,source,verdict", "name,scan,x_m,y_m,z_m,"
POINT = f"{CONTROL}east_m,north_m,"
LOCAL, EARTH, GRID = f"{POINT}up_m", f"{CONTROL}lat_deg,lon_deg,up_m", f"{CONTROL}easting_m,northing_m,up_m\n"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "by_hand.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_ties_name_scans_or_their_numbers(tmp_path: Path) -> None:
    text = "# after the second look\ntarget;source;verdict;note\ndive3;dive11.ply;reject;other pier\n7;2;ACCEPT;\n"
    first, second = read_ties(written(tmp_path, text), SCANS)
    assert (first.scans, first.verdict, first.note, first.given) == ((3, 11), "reject", "other pier", None)
    assert (second.scans, second.verdict) == ((2, 7), "accept")


def test_a_transform_follows_the_conventions(tmp_path: Path) -> None:
    """Yaw 90 to the left and 2 m ahead: what the source sees 3 m ahead lies 3 m to the target's left, and 2 m ahead."""
    (tie,) = read_ties(written(tmp_path, f"{TRANSFORM}dive1,dive4,add,2,0,0,0,0,90,0.05,1.5,\n"), SCANS)
    assert tie.given is not None
    np.testing.assert_allclose(tie.given.T_target_source.apply([3.0, 0.0, 0.0]), [2.0, 3.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(tie.given.covariance)), [np.radians(1.5)] * 3 + [0.05] * 3)
    (turned,) = read_ties(written(tmp_path, f"{TRANSFORM}4,1,add,1.5,-2.5,0.25,10,-20,170,0.05,1.5,x\n"), SCANS)
    R = Rotation.from_euler("ZYX", [170, -20, 10], degrees=True)
    T = RigidTransform.from_components([1.5, -2.5, 0.25], R)
    assert turned.given is not None
    assert turned.scans == (1, 4)
    np.testing.assert_allclose(turned.given.T_target_source.as_matrix(), T.inv().as_matrix(), atol=1e-12)


def test_the_covariance_of_an_inverted_transform_matches_draws(tmp_path: Path) -> None:
    """Drawn: errors of T_4_1 in its own tangent, seen as errors of T_1_4."""
    (tie,) = read_ties(written(tmp_path, f"{TRANSFORM}4,1,add,3,-2,1,10,-20,170,0.02,0.5,\n"), SCANS)
    assert tie.given is not None
    sigmas = np.repeat([np.radians(0.5), 0.02], 3)
    T = tie.given.T_target_source.inv()
    drawn = RigidTransform.from_exp_coords(np.random.default_rng(1).normal(size=(20_000, 6)) * sigmas)
    errors = (T * (T * drawn).inv()).as_exp_coords()  # of T_1_4 = inv(T_4_1): T_1_4_true = T_1_4 Exp(error)
    scale = np.sqrt(np.diag(tie.given.covariance))
    np.testing.assert_allclose(
        np.cov(errors.T) / np.outer(scale, scale), tie.given.covariance / np.outer(scale, scale), atol=0.04
    )


def test_control_points_in_the_maps_frame_are_read(tmp_path: Path) -> None:
    rows = "A,dive3,1.5,-2.5,0.25,310,-20,12.5,0.04,0.1,\nB,5,4,1,-3,320,-31,11,,,check\n"
    text = f"{POINT}depth_m,sigma_h_m,sigma_v_m,use\n{rows}"
    first, second = read_control(written(tmp_path, text), SCANS).points
    assert (first.name, first.scan, first.use) == ("A", 3, "control")
    np.testing.assert_array_equal(first.point, [1.5, -2.5, 0.25])
    np.testing.assert_array_equal(first.known, [310, -20, -12.5])
    np.testing.assert_array_equal(first.sigmas, [0.04, 0.04, 0.1])
    assert (second.scan, second.use) == (5, "check")
    np.testing.assert_array_equal(second.sigmas, [0.05] * 3)


def test_control_points_on_the_earth_are_placed_in_the_map(tmp_path: Path) -> None:
    """A second of latitude is 30.95 m at 60 degrees, one of longitude half of it (WGS84: 15.50 m)."""
    text = "name,scan,x_m,y_m,z_m,lat_deg,lon_deg,height_m\nA,0,1,2,3,60,5,-12.5\nB,1,1,2,3,60°00'01\"N,5 0 2 E,-10\n"
    read = read_control(written(tmp_path, text), SCANS)
    assert read.georeference == Georeference(60.0, 5.0)
    assert "the map's origin is the first control point, rounded: 60.00000, 5.00000" in read.notes
    np.testing.assert_allclose(read.points[0].known, [0, 0, -12.5], atol=1e-6)
    np.testing.assert_allclose(read.points[1].known, [31.0, 30.95, -10], atol=0.02)
    high = read_control(written(tmp_path, text), SCANS, Georeference(60.0, 5.0, height=2.5))
    np.testing.assert_allclose(high.points[0].known, [0, 0, -15.0], atol=1e-6)


def test_control_points_of_a_grid_are_placed_in_the_map(tmp_path: Path) -> None:
    """Of the 32nd zone, whose middle is 9 East, where grid North is true North and the scale 0.9996.

    Of ETRS89 they are in Europe, and not with their columns swapped.
    """
    path = written(tmp_path, f"{GRID}A,0,1,2,3,500000,6650000,-3\nB,1,1,2,3,500099.96,6650049.98,-2\n")
    world, ours = (read_control(path, SCANS, crs=f"EPSG:{code}") for code in (32632, 25832))
    assert world.georeference is not None
    assert world.georeference.longitude == pytest.approx(9.0)
    assert ours.georeference == world.georeference
    np.testing.assert_allclose(world.points[1].known - world.points[0].known, [100, 50, 1], atol=0.01)
    np.testing.assert_allclose(ours.points[0].known, world.points[0].known, atol=1e-3)
    swapped = written(tmp_path, f"{GRID}A,0,1,2,3,6650000,500000,-3\n")
    words = "not in the area .*check the CRS and the numbers"
    refuses(f"by_hand.csv: --control-crs EPSG:25832: .*{words}", read_control, swapped, SCANS, crs="EPSG:25832")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{TIE}\n1,1,reject\n", "line 2: it ties dive1 to itself"),
        (f"{TIE}\n1,dive99,reject\n", "line 2: source: no scan is called 'dive99'"),
        (f"{TIE}\n1,2,maybe\n", "line 2: verdict is 'maybe'; wanted one of accept, reject, add"),
        (f"{TIE}\n1,2,add\n# other\n2,1,reject\n", "lines 2 and 4 have a verdict on one pair"),
        (f"{TIE},kept\n1,2,add,yes\n", "line 1: there is a column 'kept'"),
        (f"{TIE},x_m\n1,2,add,3\n", "a transform needs a column y_m;"),
        (f"{TRANSFORM}1,2,accept,1,2,3,0,0,0,0.1,1,\n", "only add takes a transform"),
        (f"{TRANSFORM}1,2,add,1,2,3,0,0,nan,0.1,1,\n", "yaw_deg is 'nan'"),
        (f"{TRANSFORM}1,2,add,1,2,3,0,0,4,0,1,\n", "sigma_m is '0'; wanted a number from 0.0001"),
        (f"{LOCAL}\nA,0,1,2,3,1,2,\n", "line 2: up_m is ''; wanted meters within 20000"),
        (f"{LOCAL}\nA,0,1,2,3,432100.5,2,3\n", "go into easting_m and northing_m, with --control-crs"),
        (f"{LOCAL}\n,0,1,2,3,1,2,3\n", "line 2: the point has no name"),
        (f"{LOCAL}\nA,0,1,2,3,1,2,3\nA,1,1,2,4,1,2,4\n", "lines 2 and 3 give A different coordinates"),
        (f"{LOCAL},depth_m\nA,0,1,2,3,1,2,3,4\n", "one of the columns up_m, height_m, depth_m, and there are 2"),
        (f"{LOCAL},sigma_h_m,sigma_v_m\nA,0,1,2,3,1,2,3,0.1,\n", "can only be used together"),
        (f"{LOCAL}\n" + "A,0,1,2,3,1,2,3\n" * 1001, "has 1,001 control points; wanted at most 1,000"),
        (POINT + "lat_deg,lon_deg,up_m\nA,0,1,2,3,1,2,60,5,3\n", "wanted one of these pairs"),
        (f"{EARTH}\nA,0,1,2,3,60,5,3\nB,1,1,2,3,10,5,3\n", "within 200 km"),
        (f"{GRID}A,0,1,2,3,500000,6650000,3\n", "give --control-crs"),
    ],
)
def test_invalid_ties_and_control_points_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as refused:
        (read_ties if text.startswith("target") else read_control)(path, SCANS)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)


def test_options_that_contradict_the_points_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, POINT + "up_m\nA,0,1,2,3,1,2,3\n")
    refuses("--control-crs has no effect", read_control, path, SCANS, crs="EPSG:25832")
    refuses("--origin-heading has no effect", read_control, path, SCANS, Georeference(60.0, 5.0, heading=30.0))
    grid = written(tmp_path, f"{GRID}A,0,1,2,3,500000,6650000,3\n")
    refuses("--control-crs EPSG:0: PROJ does not know", read_control, grid, SCANS, crs="EPSG:0")
