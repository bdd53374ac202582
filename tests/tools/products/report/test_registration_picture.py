"""What a registration saw: the maps beside what is known of them, and the picture's panels."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.points.poses import upload_poses
from sonarmap.kernels.pomf.peak import find_peaks
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.prepare.range_image import visibility
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turning, random_pair
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.products.report.correlation_maps import map_rotations, slice_translation, tilt_of, yaw_of
from sonarmap.tools.products.report.registration_picture import draw_registration, registration_figure
from sonarmap.tools.products.report.registration_view import RegistrationView, contradicting, view_registration
from tests.samples.clutter_scans import refused_with_reason, said, scan, sonarmap, write

Seen = tuple[RegistrationView, RigidTransform, SpectralRegistrar, SpectralScan, SpectralScan]


@pytest.fixture(scope="module")
def seen() -> Seen:
    """A pair with a turn of -140 degrees, registered."""
    target, source, T_true = random_pair(
        13, (0.35, 0.5), Noise(1.0, 0.03), "harbor", turning=Turning("yaw", np.deg2rad(15))
    )
    registrar = SpectralRegistrar(choose_device(None), choose_grid((target, source), 64))
    a, b = registrar.prepare(target), registrar.prepare(source)
    return view_registration(registrar, a, b, registrar.register(a, b)), T_true, registrar, a, b


class TestRotationMap:
    def test_one_rotation_is_at_its_yaw_and_tilt(self) -> None:
        correlation = np.zeros((9, 64, 64), np.float32)
        correlation[3, 11, 60] = 0.7
        R = Rotation.from_euler("ZYZ", [11 * np.pi / 32, 3.5 * np.pi / 64, 60 * np.pi / 32])
        seen = map_rotations(correlation, 32, np.pi)
        row, column = np.unravel_index(seen.values.argmax(), seen.values.shape)
        assert (row, seen.values[row, column], np.count_nonzero(seen.values)) == (3, np.float32(0.7), 1)
        assert seen.yaws[column] <= np.rad2deg(yaw_of(R)) < seen.yaws[column + 1]
        assert seen.tilts[row] < np.rad2deg(tilt_of(R)) < seen.tilts[row + 1]
        assert np.rad2deg(yaw_of(R)) == pytest.approx(np.rad2deg(R.as_euler("ZYX")[0]))

    def test_what_the_bound_forbids_is_empty(self) -> None:
        """Roll and pitch up to 13 degrees, 3 of them slack: tilts up to 13 degrees are all allowed, above 18.3 none."""
        seen = map_rotations(np.ones((40, 64, 64), np.float32), 128, np.deg2rad(10))
        assert not np.isnan(seen.values[seen.tilts[1:] < 13]).any()
        assert np.isnan(seen.values[seen.tilts[:-1] > 18.4]).all()
        assert not np.isnan(seen.values[(seen.tilts[1:] > 17) & (seen.tilts[1:] < 18)]).all()

    def test_yaw_and_tilt_of_asymmetric_rotations(self) -> None:
        R = Rotation.from_euler("ZYX", [[50, 20, 0], [-120, 0, 35], [170, 30, 40]], degrees=True)
        np.testing.assert_allclose(np.rad2deg(yaw_of(R)), [50, -120, 170])
        both = np.rad2deg(np.arccos(np.cos(np.deg2rad(30)) * np.cos(np.deg2rad(40))))
        np.testing.assert_allclose(np.rad2deg(tilt_of(R)), [20, 35, both])


class TestTranslationSlice:
    @pytest.mark.parametrize("shift", [(5.0, -3.0, 2.0), (-8.0, 7.0, -8.0), (10.0, -3.0, -9.0)])
    def test_the_peak_is_where_the_shift_says_beyond_half_the_grid_too(
        self, device: Device, shift: tuple[float, float, float]
    ) -> None:
        rng = np.random.default_rng(4)
        correlation = rng.normal(size=(16, 16, 16)).astype(np.float32)
        correlation[tuple(np.array(shift, int) % 16)] = 50
        (peak,) = find_peaks(device, device.to_device(correlation))
        cut = slice_translation(correlation, peak, np.array(shift), np.array([100.0, -40.0, 7.0]), voxel=0.5)
        np.testing.assert_allclose(cut.place, np.array([100.0, -40.0]) + 0.5 * np.array(shift[:2]), atol=0.25)
        assert cut.z == 7.0 + 0.5 * shift[2]
        i, j = np.unravel_index(cut.heights.argmax(), cut.heights.shape)
        assert cut.x[i] < 100 + 0.5 * shift[0] < cut.x[i + 1]
        assert cut.y[j] < -40 + 0.5 * shift[1] < cut.y[j + 1]
        assert cut.heights.max() == pytest.approx((50 - correlation.mean()) / correlation.std(), rel=1e-4)
        assert np.sort(cut.heights, axis=None) == pytest.approx(
            np.sort((correlation[:, :, int(shift[2]) % 16] - peak.mean) / peak.std, axis=None), rel=1e-4
        )


class TestView:
    def test_it_is_of_the_answer(self, seen: Seen) -> None:
        view, T_true, registrar, _, _ = seen
        T, voxel = view.registration.T_target_source, registrar.grid.voxel
        assert np.rad2deg((T_true.inv() * T).rotation.magnitude()) < 2
        # the translation's peak is within a voxel, along each axis, of the pose that was refined
        assert np.abs(view.shifts.place - T.translation[:2]).max() <= 1.5 * voxel
        assert abs(view.shifts.z - T.translation[2]) <= 1.5 * voxel
        # which is measured before the scans' stretch is set right
        assert view.shifts.psr == pytest.approx(view.registration.psr, rel=0.05)

    def test_the_rotation_is_among_those_that_were_followed_and_high_on_the_map(self, seen: Seen) -> None:
        view, T_true, _, _, _ = seen
        assert np.rad2deg((view.followed * T_true.rotation.inv()).magnitude().min()) < 6
        row = np.searchsorted(view.turns.tilts, np.rad2deg(tilt_of(T_true.rotation))) - 1
        column = np.searchsorted(view.turns.yaws, np.rad2deg(yaw_of(T_true.rotation))) - 1
        around = view.turns.values[row - 1 : row + 2, column - 1 : column + 2]
        assert np.nanmax(around) > 0.9 * np.nanmax(view.turns.values)

    def test_the_points_lie_on_each_other(self, seen: Seen) -> None:
        """Moved by the true transform, as many points of the source have one of the target near as the overlap says."""
        from scipy.spatial import KDTree

        view, T_true, registrar, _, _ = seen
        distance, _ = KDTree(view.target.points).query(T_true.apply(view.source.points))
        assert (distance < 2 * registrar.grid.voxel).mean() > 0.3
        assert len(view.source.normals) == len(view.source.contradicting) == len(view.source.points)

    def test_contradictions_are_those_of_the_verification(self, seen: Seen) -> None:
        """Counted on the device for the sample that it takes."""
        view, _, registrar, a, b = seen
        T, voxel = view.registration.T_target_source, registrar.grid.voxel
        # turned aside, so that there are many
        R = Rotation.from_euler("z", 12, degrees=True) * T.rotation
        shift = (T.translation - a.volume.center + R.apply(b.volume.center)) / voxel
        pose = upload_poses(registrar.device, R.as_matrix()[None], shift[None])
        (shares,) = visibility(registrar.device, a.view, b.view, pose, [(1.0, 0.01)]).read()
        every = [scan.volume.surface[:: max(1, len(scan.volume.surface) // 1500)] for scan in (a, b)]
        forth = contradicting(a.view, R.apply(every[1]) + shift)
        back = contradicting(b.view, R.inv().apply(every[0] - shift))
        assert shares.contradict[0] > 0.02
        assert (forth.mean() + back.mean()) / 2 == pytest.approx(shares.contradict[0], abs=0.002)
        assert not contradicting(
            replace(a.view, places=a.view.places[:0], ranges=None), R.apply(every[1]) + shift
        ).any()


class TestPicture:
    def test_panels_units_and_marks(self, seen: Seen) -> None:
        view = seen[0]
        figure = registration_figure(view)
        panels = {axes.get_title()[:1]: axes for axes in figure.axes if axes.get_title()[:1].isdigit()}
        assert sorted(panels) == ["1", "2", "4", "5", "6"]
        assert [axes.get_title() for axes in figure.axes].count("of the target") == 1
        for number, unit in (("1", "m"), ("5", "m"), ("6", "m"), ("2", "1/m"), ("4", "°")):
            for label in (panels[number].get_xlabel(), panels[number].get_ylabel()):
                assert f"[{unit}]" in label
        R = view.registration.T_target_source.rotation
        (chosen,) = [line for line in panels["4"].lines if str(line.get_label()).startswith(("chosen", "best"))]
        assert marked(chosen) == pytest.approx(np.rad2deg([float(yaw_of(R)), float(tilt_of(R))]))
        assert marked(panels["5"].lines[0]) == pytest.approx(view.shifts.place)
        (sensor,) = [line for line in panels["6"].lines if line.get_marker() == "^"][1:]
        assert marked(sensor) == pytest.approx(view.registration.T_target_source.translation[:2])

    def test_the_headline_says_whether_to_believe_it(self, seen: Seen) -> None:
        view = seen[0]
        assert " ".join(headline(view).split()).endswith(view.registration.reason)
        assert "probability" in headline(view)
        sure = replace(view.registration, accepted=True, reason="the views agree " + 30 * "very ")
        lines = headline(replace(view, registration=sure)).splitlines()
        assert lines[1].startswith("Accepted:  yaw -139.")
        assert (len(lines), lines[2].startswith("the views agree very")) == (4, True)
        assert lines[0] == f"The source, {view.source.name}, in the frame of the target, {view.target.name}"
        assert "\nNOT accepted:  yaw" in headline(replace(view, registration=replace(sure, accepted=False)))

    @pytest.mark.slow
    def test_the_same_bytes_twice_and_not_many_whatever_the_scan_s_name(self, seen: Seen, tmp_path: Path) -> None:
        odd = replace(seen[0], target=replace(seen[0].target, name="$x^ \n\udcff " + 50 * "深"))
        paths = tmp_path / "new" / "one.png", tmp_path / "two.png"
        for path in paths:
            draw_registration(path, odd)
        assert paths[0].read_bytes() == paths[1].read_bytes()
        assert paths[0].stat().st_size < 400 * 1024
        with pytest.raises(InputError, match="a folder of that name"):
            draw_registration(tmp_path, seen[0])


class TestOption:
    @pytest.mark.slow
    def test_the_picture_lies_beside_the_result_or_is_refused(self, tmp_path: Path) -> None:
        pair = write(tmp_path, target=scan(0), source=scan(1))
        plain, drawn = (
            sonarmap("register", *pair, "--grid", "32", "--json", *more)
            for more in ((), ("--picture", tmp_path / "new" / "pair.png"))
        )
        assert (drawn.exit_code, drawn.stderr) == (plain.exit_code, "")
        told = [json.loads(result.stdout) | {"seconds": 0} for result in (plain, drawn)]
        assert told[0] == told[1]
        assert (tmp_path / "new" / "pair.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        (tmp_path / "folder.png").mkdir()
        for place, words in (("pair.jpg", "ends in .png"), ("folder.png", "a folder of that name is there")):
            refused = sonarmap("register", *pair, "--grid", "32", "--picture", tmp_path / place)
            refused_with_reason(refused)
            said(refused, words)

    @pytest.mark.parametrize("method", ["hemisphere", "icp"])
    def test_another_method_is_refused_before_the_scans_are_read(self, tmp_path: Path, method: str) -> None:
        result = sonarmap("register", "no.ply", "none.ply", "--method", method, "--picture", tmp_path / "pair.png")
        refused_with_reason(result)
        said(result, f"--method {method} has other steps", "use --method spectral")
        assert not list(tmp_path.iterdir())


def headline(view: RegistrationView) -> str:
    return registration_figure(view).get_suptitle()


def marked(line) -> np.ndarray:
    return np.concatenate(line.get_data())
