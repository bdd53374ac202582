"""Checks of the arguments of `sonarmap`'s functions."""

import os
import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from reprlib import repr as shortened
from typing import Any, ParamSpec, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from sonarmap.kernels.device.cache import LOGGER
from sonarmap.kernels.errors import InputError, path_error
from sonarmap.spectral.scan import PosePrior, Scan, refuse_mask
from sonarmap.tools.files.readers.clouds.cloud import (
    Cloud,
    refuse_map_coordinates,
    refuse_other_unit,
    scan_of_cloud,
)
from sonarmap.tools.files.user_file import naming

ScanLike: TypeAlias = Scan | NDArray[Any] | str | os.PathLike[str]  # or a point cloud of Open3D
_P = ParamSpec("_P")
_R = TypeVar("_R")

_TEXT, _NONE, _PATHS = (str,), (type(None),), (str, os.PathLike)
_PLAIN: dict[Any, Callable[[Any], object]] = {Integral: int, Real: float, bool: bool}  # kind -> type of Python
_MAX_INTEGER = 2**63 - 1
_MAX_COLUMNS = 32  # an array of three rows and more columns is taken to be transposed
_OPTION = re.compile(r"--(?:nav-)?([a-z][a-z-]*)")
# Option -> argument of the same meaning, where the names differ.
_ARGUMENT_OF = {
    **{"grid": "edge", "mount": "T_vehicle_sensor", "prior_sigmas": "sigmas", "origin_heading": "origin"},
    **{"magnetic_declination": "declination", "vertical": "origin", "correct_priors": "correct"},
}
_LENGTH = "a length in meters above zero, such as 0.5, or None"
_CHECKED_WHERE_USED = {"method", "graph"}  # as they may also be objects
_ABOVE_ZERO = {"reach", "cloud_sigma", "cell"}
# Argument -> its types, and what is wanted, for the message. Other limits of numbers are checked where they are used.
_ARGUMENTS: dict[str, tuple[tuple[Any, ...], str]] = {
    "method": (_TEXT, "the name of a method, such as 'spectral', or for `map_scans` a Registrar of your own"),
    "voxel": ((Real, *_NONE), "a length in meters above zero, such as 0.5, or None to have it chosen"),
    "edge": ((Integral,), "a whole number of voxels, such as 64"),
    "max_tilt": ((Real,), "an angle in radians, such as 0.6"),
    "device": (_TEXT + _NONE, "the name of a device in quotes, such as 'cpu', 'gpu' or '0:0', or None to choose one"),
    "seed": ((Integral,), "a whole number from 0 to 2^63 - 1"),
    **dict.fromkeys(("path", "to"), (_PATHS, "the path of a file or folder, or a pattern")),
    "progress": ((Callable, *_NONE), "a function of (steps done, steps planned so far, text), or None"),
    "ties": ((Sequence,), "a list of Tie"),
    "control": ((Sequence,), "a list of ControlPoint"),
    "graph": (_PATHS, "a PoseGraph, or the path of a file with one"),
    "start": (_TEXT, "'chordal' or 'given'"),
    **dict.fromkeys(("robust", "same_frame", "alone", "report"), ((bool, np.bool_), "True or False")),
    **dict.fromkeys(("reach", "cloud_sigma", "cell"), ((Real, *_NONE), _LENGTH)),
    "offset": ((Real,), "seconds, such as 37.0"),
    "declination": ((Real, *_NONE), "an angle in radians, or None"),
    "crs": (_TEXT + _NONE, "a projected CRS in quotes, such as 'EPSG:32632', or None"),
    "columns": ((Mapping, *_NONE), "{quantity: heading of its column}, such as {'depth_m': 'KP_DEPTH'}, or None"),
    "time_scale": (_TEXT + _NONE, "'utc', 'gps', 'tai' or None"),
    "heading_reference": (_TEXT, "'true' or 'grid'"),
    "height": (_TEXT, "the name of a height, such as 'top'"),
    "points": (_TEXT, "'map' or 'all'"),
    "sound_speed": ((Real, *_NONE), "a speed in m/s, such as 1497, or None"),
    "range_scale": ((Real,), "a factor, such as 1.02"),
    "min_range": ((Real,), "a length in meters, such as 0.05"),
    "max_range": ((Real, *_NONE), _LENGTH),
    "exclude_box": ((Sequence,), "a list of boxes, each x, y, z of two corners in meters"),
    "frame": (_TEXT + _NONE, "the name of axes, such as 'frd'"),
    "correct": (_TEXT + _NONE, "text, such as 'heading_deg=-heading_deg', or None"),
    "units": (_TEXT + _NONE, "'m', 'cm', 'mm', 'ft' or 'us-ft', or None"),
}


def require(**arguments: object) -> list[Any]:
    """The arguments in their order, with numbers as Python's int, float and bool: NumPy's small integers overflow.
    Raises InputError: an argument has a wrong type, or its number is not finite or out of range."""
    values: list[Any] = []
    for name, value in arguments.items():
        types, wanted = _ARGUMENTS[name]
        # bool is a subclass of int
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            raise _refusal(name, value, wanted)
        try:
            values.append(value if value is None else _PLAIN.get(types[0], lambda same: same)(value))
        except (OverflowError, TypeError) as error:  # such as np.timedelta64, which is an Integral too
            raise _refusal(name, value, wanted) from error
        if (types[0] is Integral and not 0 <= values[-1] <= _MAX_INTEGER) or not _is_finite(name, values[-1]):
            raise _refusal(name, value, wanted)
    return values


def _is_finite(name: str, value: object) -> bool:
    """Whether a value is finite, and above zero if its name is in `_ABOVE_ZERO`; True if it is not a float."""
    return not isinstance(value, float) or (np.isfinite(value) and (value > 0 or name not in _ABOVE_ZERO))


def require_type(name: str, values: Sequence[object], *types: type | None) -> None:
    """Raise InputError if one of an argument's values is not of one of these classes; None stands for itself."""
    for value in values:
        if not any(value is None if kind is None else isinstance(value, kind) for kind in types):
            wanted = " or ".join("None" if kind is None else kind.__name__ for kind in types)
            raise _refusal(name, value, wanted)


def _refusal(name: str, value: object, wanted: str) -> InputError:
    """The error that names an argument, what was given, and what is wanted."""
    try:
        shown = shortened(value)
    except ValueError:  # of numbers with thousands of digits
        shown = f"{type(value).__name__} too long to show"
    return InputError(f"`{name}={shown}` cannot be used; wanted {wanted}")


def as_scans(scans: Iterable[ScanLike]) -> list[Scan]:
    """The scans as `Scan`; points are stamped with their index. Raises InputError: `scans` is not an iterable of scans,
    is empty, or holds a scan that cannot be used."""
    if getattr(scans, "ndim", None) == 2:
        raise _refusal("scans", np.shape(cast("Any", scans)), "a list of scans; give one as `[points]`")
    if isinstance(scans, _PATHS) or not np.iterable(scans):
        wanted = "a list of scans; `map_scans` takes the path of a folder or file too, and `read_scans` reads it"
        raise _refusal("scans", scans, wanted)
    listed = [as_scan(scan, f"scan {k}", k) for k, scan in enumerate(scans)]
    if not listed:
        raise InputError("`scans` holds no scans; wanted at least one, as (N, 3) points in meters, a Scan or a path")
    return listed


def as_surveys(surveys: Sequence[int] | None, count: int) -> list[int] | None:
    """The survey number of each scan, as int. Raises InputError: they are not `count` ascending whole numbers."""
    if surveys is None:
        return None
    numbers: list[Any] = list(surveys) if np.iterable(surveys) else []
    whole = all(type(n) is not bool and isinstance(n, Integral) and abs(int(n)) <= _MAX_INTEGER for n in numbers)
    if len(numbers) != count or not whole or numbers != sorted(numbers):
        wanted = f"the number of each scan's survey, ascending, {count} in all, such as [0, 0, 1], or None"
        raise _refusal("surveys", surveys, wanted)
    return [int(number) for number in numbers]


def with_navigation(
    scans: Sequence[Scan], stamps: Sequence[float] | None, priors: Sequence[PosePrior | None] | None
) -> Sequence[Scan]:
    """The scans with the given stamps and priors. Raises InputError: their number or their types are wrong."""
    for name, values, kinds, wanted in (
        ("stamps", stamps, (Real,), "the time of each scan in seconds"),
        ("priors", priors, (PosePrior, type(None)), "a PosePrior of each scan, or None where there is none"),
    ):
        if values is not None and len(as_list(name, values, kinds, wanted)) != len(scans):
            raise _refusal(name, values, f"{wanted}, {len(scans)} in all")
    if stamps is not None:
        scans = [replace(scan, stamp=float(stamp)) for scan, stamp in zip(scans, stamps, strict=True)]
    if priors is not None:
        scans = [replace(scan, prior=prior) for scan, prior in zip(scans, priors, strict=True)]
    return scans


def as_list(name: str, given: object, kinds: tuple[Any, ...], wanted: str) -> list[Any]:
    """A list of one value of the `kinds`, or of an iterable of them. Raises InputError: `given` is neither."""
    if isinstance(given, kinds) and not isinstance(given, bool):
        return [given]
    listed: list[Any] = list(cast("Any", given)) if np.iterable(given) else []
    if not np.iterable(given) or not all(isinstance(value, kinds) and not isinstance(value, bool) for value in listed):
        raise _refusal(name, given, wanted)
    return listed


def as_paths(name: str, given: object) -> list[str]:
    """One path or several, as a list of strings. Raises InputError: other types."""
    return [os.fspath(path) for path in as_list(name, given, _PATHS, "a path, or a list of paths")]


def as_covariances(covariances: object, count: int) -> NDArray[Any]:
    """(count, 6, 6) float64 covariances of poses. Raises InputError: wrong shape, not finite, or not a covariance."""
    matrices = as_numbers("covariances", covariances, (count, 6, 6))
    scale = np.abs(matrices).max(initial=0.0)
    if not np.allclose(matrices, matrices.transpose(0, 2, 1), rtol=0, atol=1e-9 * scale):
        raise InputError("`covariances` are not symmetric; wanted those of poses, rotation first [rad, m]")
    if np.linalg.eigvalsh(matrices).min(initial=0.0) < -1e-9 * scale:
        raise InputError("`covariances` have negative variances; wanted those of poses, rotation first [rad, m]")
    return matrices


def as_numbers(name: str, given: object, shape: tuple[int, ...], finite: bool = True) -> NDArray[Any]:
    """The given numbers as float64. Raises InputError: not numbers, of another shape, or not finite."""
    try:
        numbers: NDArray[Any] = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise _refusal(name, given, f"numbers of shape {shape}") from error
    if numbers.shape != shape or (finite and not np.isfinite(numbers).all()):
        raise _refusal(name, given, f"finite numbers of shape {shape}")
    return numbers


def as_survey(scans: Iterable[ScanLike] | str | os.PathLike[str]) -> Sequence[Scan]:
    """Scans as in `as_scans`, or all scans of a folder, file or pattern. Raises InputError: they cannot be used."""
    if not isinstance(scans, _PATHS):
        return as_scans(scans)
    from sonarmap.tools.files.readers.scans import read_scans

    return read_scans([os.fspath(scans)]).scans


def public(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function of `import sonarmap`: `require` checks its arguments, its errors name arguments instead of
    options, and a path that the system refuses raises InputError."""
    declared = signature(function)

    @wraps(function)
    def call(*arguments: _P.args, **named: _P.kwargs) -> _R:
        given = declared.bind(*arguments, **named)
        try:
            for name in given.arguments.keys() & _ARGUMENTS.keys() - _CHECKED_WHERE_USED:
                (given.arguments[name],) = require(**{name: given.arguments[name]})
            return function(*given.args, **given.kwargs)
        except InputError as error:
            error.args = (as_arguments(str(error), declared.parameters),)
            raise
        except OSError as error:
            if (refused := path_error(error)) is None:
                raise
            raise refused from error

    return call


def as_arguments(message: str, known: Container[str]) -> str:
    """The message with options of the command line replaced by the `known` arguments of a function, such as `crs` for
    --crs and --nav-crs. Other options become arguments of `read_scans`, or stay options of the command."""

    def named(option: "re.Match[str]") -> str:
        name = option[1].replace("-", "_")
        name = _ARGUMENT_OF.get(name, name)
        if name in known:
            return f"`{name}`"
        return f"`{name}` of `read_scans`" if name in _ARGUMENTS else f"sonarmap's option {option[0]}"

    return _OPTION.sub(named, message)


def as_scan(scan: ScanLike, name: str, stamp: float = 0.0) -> Scan:
    """A `Scan` from points, from a file with one scan, or as given. Raises InputError: it is none of these, or its
    points cannot be used; the message is the same as for a file."""
    if isinstance(scan, Scan):
        refuse_map_coordinates(scan.points, f"points of {scan.name or name}")
        return scan
    if isinstance(scan, str | os.PathLike):
        from sonarmap.tools.files.readers.scans import only_scan, read_scans

        return only_scan(os.fspath(scan), read_scans([os.fspath(scan)]))
    with naming(name):
        usable, notes = scan_of_cloud(Cloud(_points(scan, name)), name, stamp)
    for note in notes:
        LOGGER.warning(f"{name}: {note}")
    with naming(name, ", or give a `Scan`"):
        refuse_other_unit(usable.points)
    return usable


def _points(given: Any, name: str) -> NDArray[Any]:
    """(N, 3) of (N, 3 or more) points, also of a point cloud of Open3D."""
    refuse_mask(given, name)
    try:
        if hasattr(given, "point"):  # of Open3D's tensor API
            given = given.point.positions.cpu().numpy()
        points: NDArray[Any] = np.asarray(given.points if hasattr(given, "points") else given)
    except Exception as error:  # lists of several lengths, or whatever an object's own `__array__` raises
        raise InputError(f"{name} is not an array ({error}); wanted points of shape (N, 3) in meters") from error
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in "fiu":
        raise InputError(f"{name} is {points.dtype} of shape {points.shape}; wanted points of shape (N, 3) in meters")
    if len(points) == 3 and points.shape[1] > _MAX_COLUMNS:
        raise InputError(f"{name} has shape {points.shape}; is it transposed? Wanted (N, 3): give `points.T`")
    return points[:, :3]
