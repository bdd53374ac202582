"""What --write of `sonarmap register` writes: the source's points in the target's frame."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.spectral.scan import Scan


def require_new_name(path: Path, inputs: Iterable[Path]) -> None:
    """Refuse a moved scan that would replace what it is made from, or that cannot be written.

    Raises InputError: naming the file.
    """
    from sonarmap.tools.files.writers.atomic import require_writable

    for source in inputs:
        if source.resolve() == path.resolve():
            raise InputError(f"--write {path} would replace {source}, which is read here; give another name")
    require_writable(path.parent)


def write_moved(path: Path, scan: "Scan", T_target_source: "RigidTransform") -> None:
    """Write a scan in the frame of another [m], its strengths as `intensity` and its viewpoints as vp_x, vp_y and vp_z.

    The suffix says the format; p_target = T p_source. Raises InputError: the file cannot be written.
    """
    from sonarmap.tools.files.writers.points import write_points

    moved = moved_scan(scan, T_target_source)
    columns = {} if moved.strength is None else {"intensity": moved.strength}
    if moved.viewpoints is not None:
        columns |= {f"vp_{axis}": moved.viewpoints[:, k] for k, axis in enumerate("xyz")}
    write_points(path, moved.points, columns)


def moved_scan(scan: "Scan", T_target_source: "RigidTransform") -> "Scan":
    """The scan with its points and viewpoints [m] in the target's frame; without its prior, which was of its own."""
    points, viewpoints = (
        None if places is None else T_target_source.apply(places.astype(float)).astype(places.dtype)
        for places in (scan.points, scan.viewpoints)
    )
    return replace(scan, points=points, viewpoints=viewpoints, prior=None)
