"""`sonarmap locate`: poses of scans in a finished map."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.method import ViewOptions, configure_method
from sonarmap.tools.command.navigation import ImuOption, NavigationReading, PriorsFile, scans_with_priors
from sonarmap.tools.command.option import INPUT, OUTPUT, JsonOption, QuietOption, checked
from sonarmap.tools.command.output import EarthPlace, open_map
from sonarmap.tools.command.survey import InputsArgument, PointReading
from sonarmap.tools.command.terminal import (
    growing_progress,
    number_table,
    print_json,
    print_result,
    printable,
    result_console,
    say,
    warn,
)

if TYPE_CHECKING:
    from sonarmap.slam.locate.place import Located, Place
    from sonarmap.tools.files.geo import Projection
    from sonarmap.tools.files.map_folder.folder import Map

NOWHERE = 3


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    inputs: InputsArgument,
    priors: PriorsFile,
    points: PointReading,
    reading: NavigationReading,
    earth: EarthPlace,
    view: ViewOptions,
    out: Path | None = OUTPUT.option(
        "FILE.tum",
        "Write the located scans' poses in the map's frame.",
        None,
        *("-o", "--out"),
        callback=checked(
            lambda path: path.suffix.lower() == ".tum", "{}; give a name that ends in .tum, as in -o track.tum"
        ),
    ),
    alone: bool = INPUT.flag("--alone", "Locate each scan independently instead of as a track."),
    imu: ImuOption = True,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where scans were taken in a finished MAP: poses in its frame and on the Earth, with uncertainties.

    p_map = T_map_scan p_scan, in meters. Scans of one folder or file are a track, whose motion narrows the search.
    The exit code is 0 if a scan was located, 3 if none was, 2 for bad input.
    """
    from sonarmap.slam.locate.locator import Locator
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.map_folder.folder import surveyed_map
    from sonarmap.tools.files.readers.scans import read_scans
    from sonarmap.tools.files.writers.atomic import require_writable

    if out is not None:
        require_writable(out.parent)
    folder = open_map(source, earth)
    surveyed = surveyed_map(folder)
    projection = earth.projection(folder.georeference if folder.on_earth(folder.parts[0]) else None)
    if priors.priors and not surveyed.measured.any():
        raise InputError(f"--priors has no effect: the frame of {source} was not measured by instruments; leave it out")
    read = read_scans(inputs, points.corrections())
    for note in read.notes:
        say(note)
    navigation = reading.settings(*priors.priors, origin=folder.georeference)
    scans = scans_with_priors(read.scans, priors, navigation, imu, allow_unknown=True).scans
    configured = configure_method(surveyed.key_scans(), view.method, survey=True)
    assert isinstance(configured.registrar, SpectralRegistrar)  # ViewOptions has no other method
    results: list[Located] = []
    with growing_progress("locating", quiet or as_json) as step:
        step(0, len(scans), "")
        locator = Locator(configured.registrar, surveyed)
        for located in map(locator.locate, scans) if alone else locator.track(scans, read.surveys):
            results.append(located)
            step(len(results), len(scans), f"{located.name} {'located' if located.located else 'not located'}")
    accepted = [located for located in results if located.located]
    if out is not None:
        _write(out, accepted)
    worlds = _worlds(folder, projection, results)
    if as_json:
        about = {"map": source, "grid": configured.edge, "voxel": configured.grid.voxel, "located": len(accepted)}
        about |= {"written": out} if out is not None and accepted else {}
        rows = [_as_json(located, world) for located, world in zip(results, worlds, strict=True)]
        print_json({"scans": rows, **about})
    else:
        _print(results, worlds)
    if not accepted:
        raise typer.Exit(NOWHERE)


def _write(path: Path, located: "Sequence[Located]") -> None:
    import numpy as np
    from scipy.spatial.transform import RigidTransform

    from sonarmap.slam.graph.trajectory import Trajectory
    from sonarmap.tools.files.writers.poses import write_tum

    if not located:
        warn(f"{path} is not written, as no scan was located")
        return
    T = RigidTransform.concatenate([each.T_map_scan for each in located])
    write_tum(path, Trajectory(np.array([each.stamp for each in located], np.float64), T))
    say(f"written to {path}: {counted(len(located), 'pose')}")


def _worlds(folder: "Map", projection: "Projection | None", found: "Sequence[Located]") -> list[dict[str, Any] | None]:
    """Places of the scans on the Earth; None for scans that were not located, or if the map's place is not known."""
    import numpy as np

    if projection is None or folder.georeference is None:
        return [None] * len(found)
    geodetic = folder.georeference.geodetic(np.array([each.T_map_scan.translation for each in found]))
    numbers = np.hstack([geodetic, projection.project(geodetic)[:, :2]]).tolist()
    names = ("latitude", "longitude", "height", "easting", "northing")
    frame = {"vertical": projection.vertical, "crs": projection.name}
    return [
        dict(zip(names, row, strict=True)) | frame if each.located else None
        for each, row in zip(found, numbers, strict=True)
    ]


def _as_json(located: "Located", world: dict[str, Any] | None) -> dict[str, object]:
    """A located scan as JSON; null for unknown values, even the pose if no view of the map matches."""
    return {
        "name": located.name,
        "stamp": located.stamp,
        "located": located.located,
        **_place(located.place),
        "psr": located.psr,
        "overlap": located.overlap,
        "world": world,
        "alternatives": [_place(other) for other in located.alternatives],
        "tracked": located.tracked,
        "seconds": located.seconds,
        "reason": located.reason,
    }


def _place(place: "Place | None") -> dict[str, object]:
    if place is None:
        return {"T_map_scan": None, "covariance": None, "sigmas": None, "probability": 0.0}
    return {
        "T_map_scan": place.T_map_scan.as_matrix(),
        "covariance": place.covariance,
        "sigmas": [math.sqrt(max(variance, 0.0)) for variance in place.covariance.diagonal().tolist()],
        "probability": place.probability,
    }


def _print(found: "Sequence[Located]", worlds: Sequence[dict[str, Any] | None]) -> None:
    """Print a row for each scan, and the number of located ones."""
    from sonarmap.slam.graph.tangent import worst_sigmas

    columns = ("x, y, z [m]", "worst sigmas", "right", "time")
    table = number_table("scan", "in the map", *columns, *(["latitude, longitude"] if any(worlds) else []), words=2)
    for each, world in zip(found, worlds, strict=True):
        cells = ["-"] * len(columns)
        if each.place is not None:
            turn, shift = worst_sigmas(each.covariance)
            place = " ".join(f"{value:.2f}" for value in each.T_map_scan.translation.tolist())
            sigmas = f"{float(shift):.2f} m {math.degrees(float(turn)):.1f}°"
            cells = [place, sigmas, f"{each.probability:.1%}", f"{each.seconds:.1f} s"]
        degrees = [f"{world['latitude']:.7f} {world['longitude']:.7f}" if world else "-"] if any(worlds) else []
        table.add_row(printable(each.name), "yes" if each.located else "no", *cells, *degrees)
    result_console().print(table)
    located = sum(each.located for each in found)
    print_result(f"\n{located} of {len(found)} {'scan was' if len(found) == 1 else 'scans were'} located in the map.")
    if len(found) == 1:
        print_result(f"because: {found[0].reason}")
