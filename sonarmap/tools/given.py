# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""What a program gives to the functions of `sonarmap`, checked before anything else sees it."""

import os
import re
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from reprlib import repr as shortened
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan, refuse_mask
from sonarmap.tools.files.readers.clouds.cloud import looks_like, refuse_map_coordinates

ScanLike: TypeAlias = Scan | NDArray[Any] | str | os.PathLike[str]

_TEXT, _NONE, _PATHS = (str,), (type(None),), (str, os.PathLike)
_PLAIN: dict[Any, Callable[[Any], object]] = {Integral: int, Real: float, bool: bool}  # Python's own of each kind
_MOST = 2**63 - 1
_COLUMNS = 32  # more of an array of three rows are points, one in each
_FARTHEST = 2000.0  # of half of a scan's points [m]: sonars that map in 3D see tens of meters, or some hundreds
_OPTION = re.compile(r"--(?:nav-)?([a-z][a-z-]*)")
# Name of an argument -> its types, and what is wanted, in words. What a number may be, they say that use it.
_ARGUMENTS: dict[str, tuple[tuple[Any, ...], str]] = {
    "method": (_TEXT, "the name of a method, such as 'spectral', or for `map_scans` a Registrar of your own"),
    "voxel": ((Real, *_NONE), "a length in meters above zero, such as 0.5, or None to have it chosen"),
    "edge": ((Integral,), "a whole number of voxels, such as 64"),
    "number": ((Real, *_NONE), "a number above zero, or None"),
    "max_tilt": ((Real,), "an angle in radians, such as 0.6"),
    "device": (_TEXT + _NONE, "the name of a device in quotes, such as 'cpu', 'gpu' or '0:0', or None to choose one"),
    "seed": ((Integral,), "a whole number from 0 to 2^63 - 1"),
    "path": (_PATHS, "the path of a file or folder, or a pattern"),
    "progress": ((Callable, *_NONE), "a function of (steps done, steps planned so far, text), or None"),
    "ties": ((Sequence,), "a list of Tie"),
    "control": ((Sequence,), "a list of ControlPoint"),
    "graph": (_PATHS, "a PoseGraph, or the path of a file with one"),
    "objective": (_TEXT, "'full' or 'isotropic'"),
    "start": (_TEXT, "'chordal', 'given' or 'incremental'"),
    "robust": ((bool, np.bool_), "True or False"),
    "keep_frames": ((bool, np.bool_), "True or False"),
    "reach": ((Real, *_NONE), "a length in meters above zero, such as 4.0, or None"),
    "sound_speed": ((Real, *_NONE), "a speed in m/s, such as 1497, or None"),
    "range_scale": ((Real,), "a factor, such as 1.02"),
    "frame": (_TEXT, "'flu', 'frd', 'rdf' or 'ned'"),
    "units": (_TEXT, "'m', 'cm', 'mm', 'ft' or 'us-ft'"),
}


def require(**arguments: object) -> list[Any]:
    """The arguments in their order, numbers as Python's own: NumPy's of few bits overflow, and fractions are no floats.
    Raises InputError: an argument's type is not its own, or its number too large: what was given and what is wanted."""
    values: list[Any] = []
    for name, value in arguments.items():
        types, wanted = _ARGUMENTS[name]
        # True is a whole number to Python
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            raise _refusal(name, value, wanted)
        try:
            values.append(value if value is None else _PLAIN.get(types[0], lambda same: same)(value))
        except (OverflowError, TypeError) as error:  # NumPy calls its time spans whole numbers
            raise _refusal(name, value, wanted) from error
        if types[0] is Integral and not 0 <= values[-1] <= _MOST:
            raise _refusal(name, value, wanted)
    return values


def require_type(name: str, values: Sequence[object], *types: type | None) -> None:
    """Refuse an argument of which a value is of none of these classes. Raises InputError: as `require`."""
    for value in values:
        if not any(value is None if each is None else isinstance(value, each) for each in types):
            wanted = " or ".join("None" if each is None else each.__name__ for each in types)
            raise _refusal(name, value, wanted)


def _refusal(name: str, value: object, wanted: str) -> InputError:
    """The error that names an argument, what was given, and what is wanted."""
    try:
        shown = shortened(value)
    except ValueError:  # of numbers with thousands of digits
        shown = f"{type(value).__name__} too long to show"
    return InputError(f"`{name}={shown}` cannot be used; wanted {wanted}")


def as_scans(scans: Iterable[ScanLike]) -> list[Scan]:
    """Each as a scan, stamped with its number where it is not one yet. Raises InputError: no iterable of scans, none in
    it, or one that cannot be used."""
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
    """The number of each scan's survey. Raises InputError: they are not as many whole numbers, ascending."""
    if surveys is None:
        return None
    numbers: list[Any] = list(surveys) if np.iterable(surveys) else []
    whole = all(type(each) is not bool and isinstance(each, Integral) and abs(int(each)) <= _MOST for each in numbers)
    if len(numbers) != count or not whole or numbers != sorted(numbers):
        wanted = f"the number of each scan's survey, ascending, {count} in all, such as [0, 0, 1], or None"
        raise _refusal("surveys", surveys, wanted)
    return [int(number) for number in numbers]


def as_survey(scans: Iterable[ScanLike] | str | os.PathLike[str]) -> Sequence[Scan]:
    """Scans as `as_scans` takes them, or all of a folder, file or pattern. Raises InputError: as these and files do."""
    if not isinstance(scans, _PATHS):
        return as_scans(scans)
    from sonarmap.tools.files.readers.scans import read_scans

    return read_scans([os.fspath(scans)]).scans


@contextmanager
def in_arguments() -> Generator[None]:
    """Have errors name arguments where they would name options."""
    try:
        yield
    except InputError as error:
        raise InputError(as_arguments(str(error))) from error


def as_arguments(message: str) -> str:
    """The message with every option of the command line as an argument: `crs` for --crs, --nav-crs."""
    return _OPTION.sub(lambda name: f"`{name[1].replace('-', '_')}`", message)


def as_scan(scan: ScanLike, name: str, stamp: float = 0.0) -> Scan:
    """A scan, the points of one, or the only scan of a file. Raises InputError: it is none of these, or its points
    cannot be used, with the same words as those of a file."""
    if isinstance(scan, Scan):
        refuse_map_coordinates(scan.points, f"points of {scan.name or name}")
        return scan
    if isinstance(scan, str | os.PathLike):
        from sonarmap.tools.files.readers.scans import only_scan, read_scans

        return only_scan(os.fspath(scan), read_scans([os.fspath(scan)]))
    return Scan(_points(scan, name).astype(np.float32), stamp=stamp, name=name)


def _points(given: object, name: str) -> NDArray[Any]:
    """(N, 3) float64 [m] of (N, 3 or more), near enough for float32; those not finite are left to `Scan`."""
    refuse_mask(given, name)
    try:
        points: NDArray[Any] = np.asarray(given)
    except Exception as error:  # lists of several lengths, or whatever an object's own `__array__` raises
        raise InputError(f"{name} is not an array ({error}); wanted points of shape (N, 3) in meters") from error
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in "fiu":
        raise InputError(f"{name} is {points.dtype} of shape {points.shape}; wanted points of shape (N, 3) in meters")
    if len(points) == 3 and points.shape[1] > _COLUMNS:
        raise InputError(f"{name} has shape {points.shape}; is it transposed? Wanted (N, 3): give `points.T`")
    points = points[:, :3].astype(np.float64)
    if len(points) and np.isfinite(points).all():
        refuse_map_coordinates(points, f"points of {name}")
        if (far := float(np.median(np.abs(points).max(axis=1)))) > _FARTHEST:
            raise InputError(
                f"{name}: half of its points lie beyond {far:,.0f} m: {looks_like(points)}; if that is meant, give "
                "them as a `Scan`"
            )
    return points
