"""The public API: `import sonarmap` offers the documented names of its packages, and loads libraries on first use."""

import inspect
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from reprlib import repr as shortened
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import sonarmap
from tests.samples.recordings import recording, written
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

NAMES = sonarmap.__all__
VALUES = {name: getattr(sonarmap, name) for name in NAMES}


class TestNames:
    def test_public_names_are_those_of_the_packages(self) -> None:
        packages = [import_module(f"sonarmap.{package}") for package in ("spectral", "slam", "tools")]
        kernels = {name for name in NAMES if VALUES[name].__module__.startswith("sonarmap.kernels.")}
        assert set(NAMES) == {name for package in packages for name in package.__all__} | kernels
        assert kernels < set(import_module("sonarmap.kernels").__all__)
        assert all(getattr(sonarmap, name) is not None for name in NAMES)
        names: dict[str, object] = {}
        exec("from sonarmap import *", names)
        assert set(NAMES) <= set(names)
        with pytest.raises(AttributeError, match="No sonarmap attribute registre"):
            # pyrefly: ignore[missing-attribute]
            _ = sonarmap.registre

    def test_import_loads_no_library_and_ignores_other_packages_of_the_same_names(self, tmp_path: Path) -> None:
        for package in ("kernels", "spectral", "slam", "tools"):
            (tmp_path / package).mkdir()
            (tmp_path / package / "__init__.py").write_text(f"raise SystemExit('the {package} of another project')\n")
        program = (
            "import sys, sonarmap; print([m for m in ('numpy', 'scipy', 'gtsam', 'pyopencl') if m in sys.modules])\n"
            "print(sonarmap.Scan.__module__, callable(sonarmap.register))"
        )
        shown = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
        assert (shown.stdout, shown.stderr) == ("[]\nsonarmap.spectral.scan True\n", "")


def described(value: Any) -> str:
    return inspect.getdoc(value) or ""


@pytest.mark.parametrize("name", NAMES)
def test_names_arguments_and_exceptions_are_documented(name: str) -> None:
    value, docstring = VALUES[name], described(VALUES[name])
    assert len(docstring) > 15
    if is_dataclass(value):
        arguments = [field.name for field in fields(value) if not field.name.startswith("_")]
    else:
        arguments = [*inspect.signature(value).parameters] if inspect.isfunction(value) else []
    missing = [
        each for each in arguments if not re.search(rf"^    ([\w, ]+, )?{each}\b[\w, ]*: ", docstring, re.MULTILINE)
    ]
    assert not {*missing} - {"device"}
    if inspect.isfunction(value) and "raise " in inspect.getsource(value):
        assert "Raises:" in docstring


def points(seed: int, dtype: type = np.float64) -> np.ndarray:
    """A rough bed under a sensor, with blocks on it."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-20, 20, (8000, 2))
    z = 0.5 * np.sin(xy[:, 0] / 3) - 8 + 3.0 * ((abs(xy[:, 0] - 5) < 3) & (abs(xy[:, 1] + 4) < 2))
    z += 5.0 * ((abs(xy[:, 0] + 7) < 2) & (abs(xy[:, 1] - 6) < 4))
    return np.column_stack([xy, z]).astype(dtype)


TRUTH = ring_poses(4, turns=0.2)
KNOWING = KnowingRegistrar(TRUTH, 1e-4 * np.eye(6))
T_TARGET_SOURCE = RigidTransform.from_exp_coords([0.02, -0.03, 0.4, 2.0, -1.5, 0.3])


class TestRegister:
    @pytest.mark.parametrize("dtype", [np.float16, pytest.param(np.float64, marks=pytest.mark.slow)])
    def test_two_clouds_of_any_float_type(self, tmp_path: Path, dtype: type) -> None:
        """The target is the path of a file, the source an array."""
        np.save(tmp_path / "target.npy", points(1, dtype))
        source = T_TARGET_SOURCE.inv().apply(points(2)).astype(dtype)
        found = sonarmap.register(tmp_path / "target.npy", source, edge=32)
        error = T_TARGET_SOURCE.inv() * found.T_target_source
        assert np.linalg.norm(error.translation) < 1.0  # less than a voxel of this grid
        assert error.rotation.magnitude() < 0.02

    @pytest.mark.slow
    def test_prepared_scans_give_the_same_transform(self) -> None:
        source = T_TARGET_SOURCE.inv().apply(points(2))
        a, b = sonarmap.prepare([points(1), source], edge=32)
        again, once = sonarmap.register(a, b), sonarmap.register(points(1), source, edge=32)
        np.testing.assert_array_equal(again.T_target_source.as_matrix(), once.T_target_source.as_matrix())
        (other,) = sonarmap.prepare([points(1)], edge=32)
        for source, message in ((other, "one call of prepare"), (points(2), "only one of the two")):
            with pytest.raises(sonarmap.InputError, match=message):
                sonarmap.register(a, source)

    @pytest.mark.parametrize(
        ("target", "options", "message"),
        [
            (np.zeros((3, 500)), {}, r"scan 0 has shape \(3, 500\); is it transposed\?"),
            (np.full((50, 3), np.nan), {}, "NaN or infinite"),
            (np.array([["a", "b", "c"]]), {}, "wanted points"),
            (points(1), {"edge": 103}, "`edge=103`"),
            ("nowhere.ply", {}, "nowhere.ply"),
            (1000 * points(1), {}, r"scan 0: half of its points .* are these millimeters"),
            (1e5 * points(1), {}, r"lie beyond 100 km .* are these millimeters"),
            (points(1) + 5000.0, {}, r"map coordinates .*local grid"),
        ],
    )
    def test_invalid_arguments_are_refused(self, target: Any, options: dict[str, Any], message: str) -> None:
        with pytest.raises(sonarmap.InputError, match=message) as refused:
            api.register(target, points(2), **{"method": "icp"} | options)
        assert "--" not in str(refused.value)  # arguments, not options of the command line

    def test_map_coordinates_are_refused(self, tmp_path: Path) -> None:
        """In arrays as in files; float32 would round them to centimeters."""
        far = points(1) + np.array([500_000.0, 5_800_000.0, 0.0])
        np.save(tmp_path / "far.npy", far)
        words = r"8,000 of 8,000 points .*lie beyond 100 km .*map coordinates.*subtract the sensor's position"
        for given in (far, tmp_path / "far.npy", sonarmap.Scan(far.astype(np.float32))):
            with pytest.raises(sonarmap.InputError, match=words):
                sonarmap.register(given, points(2), method="icp")
        for use in (sonarmap.prepare, sonarmap.map_scans, lambda given: sonarmap.fuse(given, TRUTH[:2], 0.5)):
            with pytest.raises(sonarmap.InputError, match="these look like map coordinates"):
                use([far.astype(np.float32), points(2)])

    def test_extra_columns_and_bad_points_are_dropped_and_masks_refused(self, caplog: pytest.LogCaptureFixture) -> None:
        wide = np.column_stack([points(1), np.full(8000, -1.0), np.full(8000, np.nan)])
        wide[::8, :3] = np.nan
        wide[1::8, 2] = np.inf
        (scan,) = sonarmap.prepare([wide], method="icp")
        kept = wide[np.isfinite(wide[:, :3]).all(axis=1), :3].astype(np.float32)
        np.testing.assert_array_equal(scan.scan.points, kept)
        assert "scan 0: dropped 2,000 of 8,000 points that are NaN or infinite" in caplog.text
        masked = np.ma.masked_array(points(1), np.zeros((8000, 3), bool))
        sonarmap.prepare([masked], method="icp")
        masked[3] = np.ma.masked
        rows: Any = list(masked)
        for use in (
            lambda: sonarmap.prepare([masked]),
            lambda: sonarmap.Scan(masked.astype(np.float32)),
            lambda: sonarmap.prepare([rows]),
        ):
            with pytest.raises(sonarmap.InputError, match=r"masked, and masks are not used; .*getmaskarray"):
                use()

    @pytest.mark.parametrize("tensors", [False, True])
    def test_points_of_open3d_that_are_not_finite_are_dropped(self, tensors: bool) -> None:
        o3d = pytest.importorskip("open3d")
        holed = points(1)
        holed[3] = np.nan
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(holed))
        cloud = o3d.t.geometry.PointCloud.from_legacy(cloud) if tensors else cloud
        (scan,) = sonarmap.prepare([cloud], method="icp")
        np.testing.assert_array_equal(scan.scan.points, np.delete(holed, 3, axis=0).astype(np.float32))


class TestOtherFunctions:
    def test_map_scans_uses_stamps_and_priors(self) -> None:
        """The prior of one scan places the map in the world; wrong numbers of stamps or priors are refused."""
        method, stamps = KnowingRegistrar(TRUTH, 1e-4 * np.eye(6)), [10.0, 12.5, 15.0, 17.5]
        T = RigidTransform.from_components([4.0, -3.0, -2.0], Rotation.from_euler("z", 0.7)) * TRUTH[0]
        prior = sonarmap.PosePrior(T, np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))
        scans = scans_of(TRUTH)
        result = sonarmap.map_scans(scans, method=method, voxel=0.5, stamps=stamps, priors=[prior, None, None, None])
        np.testing.assert_array_equal(result.trajectory.stamps, stamps)
        np.testing.assert_allclose(result.trajectory.T_world_sensor.as_matrix()[0], T.as_matrix(), atol=0.05)
        for given, words in (
            ({"stamps": stamps[:3]}, "`stamps=.*wanted the time of each scan in seconds, 4 in all"),
            ({"stamps": ["10:00"] * 4}, "`stamps=.*wanted the time of each scan in seconds"),
            ({"priors": [T] * 4}, "`priors=.*wanted a PosePrior of each scan"),
        ):
            with pytest.raises(sonarmap.InputError, match=words):
                api.map_scans(scans, method=method, voxel=0.5, **given)

    def test_read_scans_corrects_axes_units_and_ranges(self, tmp_path: Path) -> None:
        """Axes frd in millimeters with ranges 2 % too short, and a corrected speed of sound."""
        np.save(tmp_path / "scan.npy", np.array([[1000.0, -2500.0, 750.0], [300.0, 40.0, -5000.0]]))
        (scan,) = sonarmap.read_scans(tmp_path, frame="frd", units="mm", range_scale=1.02)
        np.testing.assert_allclose(scan.points, [[1.02, 2.55, -0.765], [0.306, -0.0408, 5.1]], rtol=1e-6)
        written(tmp_path / "dive.sonar", recording(2))
        wrong, right = (sonarmap.read_scans(tmp_path / "dive.sonar", sound_speed=speed) for speed in (None, 1517.0))
        for scan, other in zip(right, wrong, strict=True):
            np.testing.assert_allclose(scan.points, 1517.0 / 1480.0 * other.points, rtol=1e-6)


api: Any = sonarmap  # without types, so that tests may pass invalid arguments


class Broken:
    """Raises an error when it is converted to an array."""

    def __array__(self, *_: object) -> np.ndarray:
        raise RuntimeError("no memory left")


class TestArguments:
    """Arguments of a wrong type are refused by name, with what was given and what is wanted."""

    @pytest.mark.parametrize("number", [Fraction(3, 2), np.float16(1.5)])
    @pytest.mark.filterwarnings("error")
    def test_numbers_of_any_type_are_accepted(self, number: Any) -> None:
        options = {"edge": np.int8(32), "voxel": number, "max_tilt": number, "seed": np.uint64(3)}
        grid = api.prepare([points(1)], **options)[0].registrar.grid
        assert (grid, type(grid.edge), type(grid.voxel)) == (api.Grid(32, 1.5), int, float)
        assert api.map_scans(scans_of(TRUTH), method=KNOWING, **options).voxel == 1.5

    @pytest.mark.parametrize(
        ("name", "value", "words"),
        [
            ("edge", 0, "try `edge=16` or `edge=18`"),
            ("edge", True, "wanted a whole number of voxels"),
            ("edge", np.timedelta64(16, "s"), "wanted a whole number of voxels"),
            pytest.param("voxel", 10**400, "wanted a length in meters", id="huge voxel"),
            ("max_tilt", "x", "wanted an angle in radians"),
            ("seed", 2**63, "wanted a whole number from 0"),
            ("device", 5, "wanted the name of a device"),
            ("method", [], "wanted the name of a method"),
        ],
    )
    def test_invalid_arguments_of_registration(self, name: str, value: object, words: str) -> None:
        given = {"method": "icp", name: value}
        for call in (
            lambda: api.register(points(1), points(2), **given),
            lambda: api.prepare([points(1)], **given),
            lambda: api.map_scans([points(1), points(2)], **given),
        ):
            with pytest.raises(sonarmap.InputError, match=re.escape(f"`{name}={shortened(value)}`") + f".*{words}"):
                call()

    @pytest.mark.parametrize(
        ("call", "words"),
        [
            (lambda: api.map_scans(None), "`scans=None` cannot be used; wanted a list of scans"),
            (lambda: api.map_scans(points(1)), r"give one as `\[points\]`"),
            (lambda: api.map_scans([None, points(1)]), r"scan 0 is object of shape \(\); wanted points"),
            (lambda: api.map_scans([points(1)] * 2, settings=3), "`settings=3` .*wanted MapperSettings or None"),
            (lambda: api.map_scans([points(1)] * 2, ties=[1]), "`ties=1` .*wanted Tie"),
            (lambda: api.map_scans([points(1)] * 2, method=3), "`method=3` .*wanted the name"),
            (lambda: api.map_scans([points(1)] * 2, method=KnowingRegistrar), "`method=<class .*a Registrar of"),
            (lambda: api.map_scans([points(1)] * 2, progress=5), "`progress=5` .*wanted a function of"),
            (lambda: api.map_scans([Broken(), points(1)]), "scan 0 is not an array .no memory left.; wanted points"),
            (lambda: api.map_scans([]), "`scans` holds no scans; wanted at least one"),
            (lambda: api.prepare("nofile"), "`scans='nofile'` cannot be used; wanted a list of scans; `map_scans` t"),
            (lambda: api.prepare([points(1)], edge=10**5000), "`edge=int too long to show` .*wanted a whole number"),
            (lambda: api.read_scans(5), r"`paths=\(5,\)` .*wanted a path"),
            (lambda: api.read_scans("a.ply", range_scale=0.0), "`range_scale=0` is not a factor"),
            (lambda: api.read_scans("a.ply", sound_speed=10**400), "`sound_speed=10*.*0` .*wanted a speed"),
            (lambda: api.read_scans("a.ply", sound_speed=15.0), "`sound_speed=15` is not a speed of sound in water"),
            (lambda: api.read_scans("a.ply", frame="fud"), "'fud' is not known; name the directions of x, y and z"),
            (lambda: api.read_scans("a.ply", units="inch"), "'inch' is not known; choose one of m, cm"),
            (lambda: api.optimize(None), "`graph=None` .*wanted a PoseGraph, or the path"),
            (lambda: api.optimize("a.g2o", start=[]), r"`start=\[\]` .*wanted 'chordal' or 'given'"),
        ],
    )
    def test_invalid_arguments_of_other_functions(self, call: Any, words: str) -> None:
        with pytest.raises(sonarmap.InputError, match=words):
            call()

    @pytest.mark.parametrize(
        "surveys",
        [
            *(1, "01", [0], [0, None], [0, 10**5000], [1, 0], [0.0, 1.0], [False, True], np.zeros((2, 1), int)),
        ],
    )
    def test_invalid_survey_numbers(self, surveys: object) -> None:
        words = r"(?s)`surveys=.*cannot be used; wanted the number of each scan's survey, ascending, 2 in all"
        with pytest.raises(sonarmap.InputError, match=words):
            api.map_scans([points(1)] * 2, method="icp", surveys=surveys)


BAD = [None, "text", -1, 0.0, True, np.nan, [], [None], {}, np.zeros((2, 2)), np.full((4, 3), np.nan), np.empty((0, 3))]
BAD += [np.full((4, 6, 6), np.nan), -np.stack([np.eye(6)] * 4)]
MADE = {"method": "icp", "voxel": 0.5, "edge": 32, "max_tilt": 0.6, "device": None, "seed": 0}


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    folder, scans = tmp_path_factory.mktemp("valid"), scans_of(TRUTH)[:2]
    result = api.map_scans(scans, method=KNOWING, voxel=0.5)
    finished = api.write_map(result, folder / "map", report=False)
    rows = "".join(f"{scan.name},3.0,0.1\n" for scan in scans)
    (folder / "log.csv").write_text("name,depth_m,depth_sigma_m\n" + rows)
    np.save(folder / "a.npy", points(1))
    pair = {"target": points(1)[::8], "source": points(1)[::8], **MADE}
    graph = api.PoseGraph(result.trajectory, result.edges)
    corrections = {"sound_speed": None, "range_scale": 1.0, "frame": None, "units": "m"}
    survey = dict.fromkeys(("settings", "surveys", "odometry", "progress")) | {"ties": (), "control": ()}
    options = dict.fromkeys(("origin", "cell", "scans", "progress"))
    log = dict.fromkeys(("origin", "sigmas", "columns", "time_scale", "crs", "frame", "declination"))
    return {
        "choose_device": {"selector": None},
        "choose_grid": {"scans": scans, "edge": 32, "voxel": 0.5},
        "register": pair,
        "prepare": {"scans": [points(1)[::8]], **MADE},
        "map_scans": {"scans": scans, **MADE, "method": KNOWING, **survey},
        "read_scans": {"paths": folder / "a.npy", **corrections},
        "optimize": {"graph": graph, "start": "chordal", "robust": False},
        "export_map": {
            **{"folder": finished, "to": folder / "out", "formats": "xyz", "crs": "map", "height": "top"},
            **{"points": "map", "scans_from": (), **options},
        },
        "read_navigation": {
            **{"logs": folder / "log.csv", "scans": scans, "offset": 0.0, "heading_reference": "true"},
            **{"T_vehicle_sensor": None, **log},
        },
        "fuse": {"scans": scans, "poses": TRUTH[:2], "voxel": 0.5, "covariances": result.covariances, "surveys": None},
    }


class TestBadValues:
    """A bad value of any argument is accepted or raises SonarmapError, whose message names the argument and no option
    of the command line."""

    QUICK = ("choose_device", "choose_grid", "prepare", "read_scans", "optimize", "read_navigation")
    SLOW = tuple(pytest.param(name, marks=pytest.mark.slow) for name in ("register", "map_scans", "export_map", "fuse"))

    @pytest.mark.parametrize("name", [*QUICK, *SLOW])
    def test_raise_only_sonarmap_errors(self, name: str, valid: dict[str, dict[str, Any]], tmp_path: Path) -> None:
        def call(given: dict[str, Any]) -> object:
            function = getattr(api, name)
            return function(given.pop("paths"), **given) if "paths" in given else function(**given)

        call({**valid[name]})
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)  # some functions write to it
            refused: list[tuple[str, str]] = []
            for argument in valid[name]:
                for value in BAD:
                    try:
                        call({**valid[name], argument: value})
                    except sonarmap.SonarmapError as error:
                        refused.append((argument, str(error)))
        assert len(refused) > len(BAD) / 2
        for argument, words in refused:
            assert "--" not in words
            assert {*re.findall(r"`(\w+)=", words)} <= {argument, "edge", "units"}, words
