"""Points corrected as they are read: ranges by the speed of sound or a factor, axes and units worked by hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.scans import Corrections, PointFrame, read_scans, read_survey
from tests.samples.cloud_files import TABLE
from tests.samples.recordings import range_image
from tests.samples.refusals import refuses

POINTS = np.array([[1.5, -2.25, 0.75], [6.75, 0.125, -3.5]])


def write_recording(path: Path, speeds: list[float]) -> np.ndarray:
    """Shots of one wall, 1 to 7 m off, each with ranges that a sonar with this speed of sound computes; their truth."""
    true_ranges = np.random.default_rng(1).uniform(1.0, 7.0, (6, 8))
    packets = []
    for shot, speed in enumerate(speeds):
        image = range_image(shot, np.rint(true_ranges * (speed or 1500.0) / 1500.0 / 1e-4).astype(int))
        image.image_pixel_scale, image.speed_of_sound = 1e-4, speed
        packets.append(rip.packb(image))
    path.write_bytes(b"".join(packets))
    return true_ranges


def test_ranges_are_corrected_by_the_sound_speed_of_each_shot(tmp_path: Path) -> None:
    """Each shot by the speed that it was recorded with."""
    path = tmp_path / "dive.sonar"
    truth = write_recording(path, [1500 / 1.026, 1500 * 1.026, 1500.0])
    wrong = read_scans([path]).scans
    for scan, off in zip(wrong, (1 / 1.026, 1.026, 1.0), strict=True):
        np.testing.assert_allclose(np.linalg.norm(scan.points, axis=1) / truth.ravel(), off, rtol=1e-4)
    for scan in read_scans([path], Corrections(1500.0)).scans:
        scale = np.linalg.norm(scan.points, axis=1) / truth.ravel()
        assert np.abs(scale - 1).max() < 1e-4
    for scan, other in zip(read_scans([path], Corrections(1500.0, 2.0)).scans, wrong, strict=True):
        assert np.linalg.norm(scan.points, axis=1).mean() == pytest.approx(2 * truth.mean(), rel=1e-5)
        assert len(scan.points) == len(other.points)


def test_points_are_scaled_from_their_viewpoints() -> None:
    viewpoints = np.array([[1.0, 0.0, 0.5], [-2.0, 1.0, 0.0]])
    cloud = Corrections(scale=1.5).corrected(Cloud(POINTS, viewpoints=viewpoints))
    np.testing.assert_allclose(cloud.points, [[1.75, -3.375, 0.875], [11.125, -0.3125, -5.25]])
    np.testing.assert_array_equal(Corrections(scale=2.0).corrected(Cloud(POINTS)).points, 2 * POINTS)
    assert Corrections().corrected(cloud) is cloud
    assert PointFrame().turned(cloud) is cloud


def test_a_sound_speed_or_frame_that_the_format_does_not_take_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", TABLE)
    words = r"a\.npy: `sound_speed` cannot be used, as a NumPy .* `range_scale`"
    refuses(words, read_survey, [tmp_path], corrections=Corrections(1500.0))
    (tmp_path / "dive.sonar").write_bytes(b"RIP2")
    words = r"dive\.sonar: `frame` and `units` cannot be used"
    refuses(words, read_survey, [tmp_path / "dive.sonar"], corrections=Corrections(frame=PointFrame("frd")))


def test_a_shot_without_a_sound_speed_leaves_a_gap(tmp_path: Path) -> None:
    write_recording(tmp_path / "dive.sonar", [1480.0, 0.0, 1490.0])
    read = read_survey([tmp_path], corrections=Corrections(1500.0))
    assert [scan.name for scan in read.scans] == ["dive#0", "dive#2"]
    assert "dive.sonar#1: it does not say the speed of sound" in read.unread[0].reason


AXES_UNKNOWN = [(name, "m") for name in ("", "fl", "flux", "flb", "fnu", "FLU", "xyz")]


@pytest.mark.parametrize(
    ("made", "given", "words"),
    [
        *((Corrections, (v,), "not a speed of sound in water; wanted 1000 to 2000") for v in (0, 343, 15000, np.nan)),
        *((Corrections, (None, factor), "is not a factor") for factor in (0, -1, np.nan, np.inf)),
        *((PointFrame, names, "name the directions of x, y and z") for names in AXES_UNKNOWN),
        (PointFrame, ("flu", "inch"), "choose one of"),
    ],
)
def test_invalid_corrections_are_refused(made: Callable[..., object], given: tuple, words: str) -> None:
    refuses(words, made, *given)


def test_axes_and_units_are_converted_before_ranges_are_scaled(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", np.array([[5000.0, 2000, 1000]] * 3))  # mm, right and down positive
    read = read_scans([tmp_path / "scan.npy"], Corrections(scale=2.0, frame=PointFrame("frd", "mm")))
    np.testing.assert_allclose(read.scans[0].points, [[10, -4, -2]] * 3)


# 5 m ahead, 2 m to starboard, 1 m below the sensor, as each convention writes it; ned: the sensor looks North
AHEAD_RIGHT_BELOW = {
    **{"flu": (5, -2, -1), "frd": (5, 2, 1), "rdf": (2, 1, 5), "ned": (5, 2, 1)},
    **{"fru": (5, 2, -1), "ulb": (-1, -2, -5), "enu": (2, 5, -1), "swd": (-5, -2, 1)},
}


@pytest.mark.parametrize("axes", AHEAD_RIGHT_BELOW)
def test_axes_of_every_convention_are_converted(axes: str) -> None:
    wanted = (2, 5, -1) if axes in ("ned", "enu", "swd") else (5, -2, -1)  # East, North, Up; or forward, left, up
    cloud = Cloud(np.array([AHEAD_RIGHT_BELOW[axes]], np.float32), viewpoints=np.array([AHEAD_RIGHT_BELOW[axes]]))
    turned = PointFrame(axes).turned(cloud)
    np.testing.assert_array_equal(turned.points, [wanted])
    assert turned.viewpoints is not None
    np.testing.assert_array_equal(turned.viewpoints, [wanted])
