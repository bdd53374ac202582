"""`sonarmap section`: a map cut along a line; `sonarmap volume`: cut and fill between a map and a plane or map."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import INPUT, OUTPUT, REQUIRED, JsonOption, QuietOption, checked, is_positive
from sonarmap.tools.command.output import CELL, SAME_FRAME, EarthPlace, open_map
from sonarmap.tools.command.terminal import print_json, print_result, print_rows, say
from sonarmap.tools.products.export.formats import HEIGHTS

if TYPE_CHECKING:
    from sonarmap.tools.products.section import PlacedMap

_VOXELS = 2  # default of --width


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Options of the line along which the map is cut."""

    start: str = INPUT.option("X,Y", "Start of the line, in the map's frame \\[m].", REQUIRED, "--from")
    end: str = INPUT.option("X,Y", "End of the line.", REQUIRED, "--to")
    world: bool = INPUT.flag("--world", "--from and --to are easting, northing in the map's CRS or in --crs.")
    width: float | None = INPUT.length("Use points within this distance of the line, on each side \\[m].", "two voxels")


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionFiles:
    """Options of the output files."""

    out: Path = OUTPUT.option(
        "FILE", "NAME.png: picture and tables; NAME.csv: the tables alone.", REQUIRED, "-o", "--out"
    )
    cell: float | None = OUTPUT.length("Length of a cell of the profile \\[m].", CELL)
    exaggeration: float = OUTPUT.option(
        "F",
        "Stretch heights in the picture by this factor.",
        1.0,
        callback=checked(is_positive, "{}; give a number above 0, or leave it out for one scale"),
        rare=True,
    )


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    line: Line,
    files: SectionFiles,
    earth: EarthPlace,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Cut a finished MAP along a line: a picture of distance against height, and tables of points and of a profile.

    NAME.csv has every point near the line, NAME_profile.csv the median in cells along it. --from and --to are x, y in
    the map's frame, or with --world eastings and northings, if the map's place is known.
    """
    import numpy as np

    from sonarmap.tools.products.export.grid import default_cell
    from sonarmap.tools.products.section import (
        Coordinates,
        PlacedMap,
        Titles,
        check_names,
        profile_of,
        section_of,
        write_section,
    )

    check_names(files.out, source)
    ends = np.array([_place(name, text) for name, text in (("--from", line.start), ("--to", line.end))])
    placed = PlacedMap.of(open_map(source, earth))
    projection = earth.projection(placed.georeference)
    world = None if projection is None else Coordinates(placed.georeference, projection)
    if line.world and world is None:
        raise InputError(f"--world needs the place of {placed.path} on the Earth; give --origin LAT,LON, or x,y")
    given = world if line.world and world is not None else Coordinates()
    if not placed.upright:
        say("no instrument measured which way is up; heights are along the z axis of the map's frame")
    section = section_of(placed, given.to_map(ends), line.width or _VOXELS * placed.voxel, given)
    cell = files.cell or default_cell(placed.voxel)
    profile = profile_of(section, cell)
    lowest, highest = float(section.height.min()), float(section.height.max())
    stretched = "" if files.exaggeration == 1 else f"; heights stretched {files.exaggeration:g} times"
    title = f"{source.resolve().name}: section from {given.said(ends[0])} to {given.said(ends[1])}"
    about = (
        f"{section.length:.2f} m, {counted(len(section.height), 'point')} within {section.width:.3g} m to either side"
    )
    titles = Titles(title, f"{about}; places: {given.names}{stretched}", placed.height_words, files.exaggeration, cell)
    written = write_section(files.out, section, profile, titles, world)
    if as_json:
        numbers = {"length_m": section.length, "width_m": section.width, "cell_m": cell, "points": len(section.height)}
        heights = {"lowest_m": lowest, "highest_m": highest, "heights": placed.height_words}
        ways = {"from": ends[0], "to": ends[1], "places": given.names}
        about_it = {"map": source, **ways, **numbers, **heights, "cells": len(profile.height)}
        print_json({**about_it, "files": written})
        return
    print_result(f"{about}: {lowest:.2f} to {highest:.2f} m, {placed.height_words}")
    print_result(f"written to {files.out.parent}: {', '.join(path.name for path in written)}")


def _place(name: str, text: str) -> list[float]:
    from sonarmap.tools.files.readers.csv_table import number

    numbers = [number(part) for part in text.split(",")]
    if len(numbers) != 2 or not all(map(math.isfinite, numbers)):
        raise InputError(f"{name} is {text!r}; wanted two numbers separated by a comma, as in {name}=-12.5,40")
    return numbers


@dataclass(frozen=True, slots=True)
class Target:
    """Options of what the map is compared with, and how."""

    level: float | None = INPUT.option(
        "Z", "Height of a plane \\[m].", callback=checked(math.isfinite, "--level is {}; wanted a height in meters")
    )
    same_frame: bool = INPUT.flag("--same-frame", SAME_FRAME)
    cell: float | None = INPUT.length("Edge of a cell of both grids \\[m].", CELL)
    height: str = INPUT.choice(
        "Height of a cell, as for `export`: top (mean of its uppermost surface), mean or shoalest.", HEIGHTS
    )
    min_seen: int = INPUT.option("N", "Use points that at least N scans saw.", 1, min=1)


def volume(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    target: Target,
    other: Annotated[
        Path | None, typer.Argument(help="Another map, in place of --level.", metavar="[OTHER]", show_default=False)
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Compute cut and fill to a plane or another map, with sigmas.

    Cut is the volume above the plane, or lost; fill the volume missing below it, or gained. Surfaces are compared where
    both were seen; the areas seen by only one of two maps are printed too.
    """
    from sonarmap.tools.products.export.grid import default_cell
    from sonarmap.tools.products.section import volume_between, volume_to_level

    if (target.level is None) == (other is None):
        given = "neither" if target.level is None else "both"
        raise InputError(f"{given} of --level and OTHER given; wanted one: --level Z for a plane, or another map")
    if other is None and target.same_frame:
        raise InputError("--same-frame has no effect without OTHER; leave it out")
    first = _opened(source, target.min_seen)
    if other is not None:
        second = _opened(other, target.min_seen)
        if None in (first.georeference, second.georeference):
            if not target.same_frame:
                raise InputError(
                    f"{source} and {other} are not both placed on the Earth; wanted two maps in one frame: map "
                    "again with positions or --origin, or give --same-frame if they are in one anyway"
                )
            first, second = (replace(each, georeference=None) for each in (first, second))  # heights as they are, too
        cell = target.cell or default_cell(max(first.voxel, second.voxel))
        volume, words = volume_between(first, second, cell, target.height), ("lost", "gained")
    else:
        assert target.level is not None
        volume = volume_to_level(first, target.level, target.cell or default_cell(first.voxel), target.height)
        words = "above the plane", "missing below it"
    if as_json:
        ends = {"map": source, "level_m": target.level, "to": other}
        print_json({**ends, "heights": first.height_words, **volume.as_json})
        return
    rows = {f"cut ({words[0]})": volume.cut, f"fill ({words[1]})": volume.fill, "net (fill - cut)": volume.net}
    print_rows({name: f"{number:,.2f} m3, sigma {sigma:,.2f} m3" for name, (number, sigma) in rows.items()})
    print_result(f"{volume.compared:,.1f} m2 were compared, in cells of {volume.cell:.3g} m; {first.height_words}")
    if other is not None:
        print_result(
            f"{volume.map_only:,.1f} m2 are in {source} alone and {volume.target_only:,.1f} m2 in {other} alone: "
            "these were not compared"
        )


def _opened(path: Path, least: int) -> "PlacedMap":
    """The largest part of a map, with the points that at least `least` scans saw."""
    from sonarmap.tools.products.section import PlacedMap

    placed = PlacedMap.of(open_map(path))
    if not placed.upright:
        say(f"no instrument measured which way is up in {path}; heights are along the z axis of its frame")
    return placed.seen_by(least)
