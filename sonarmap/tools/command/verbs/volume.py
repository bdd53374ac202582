"""`sonarmap volume`: how much lies between a finished map and a plane, or another map."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import INPUT, JsonOption, QuietOption, checked
from sonarmap.tools.command.output import CELL, SAME_FRAME, open_map
from sonarmap.tools.command.terminal import print_json, print_result, print_rows, say
from sonarmap.tools.products.export.formats import HEIGHTS

if TYPE_CHECKING:
    from sonarmap.tools.products.section import PlacedMap


@dataclass(frozen=True, slots=True)
class Target:
    """What the map is compared to."""

    level: float | None = INPUT.option(
        "Z",
        "Height of a plane \\[m].",
        callback=checked(math.isfinite, "--level is {}; wanted a height in meters"),
    )
    same_frame: bool = INPUT.flag("--same-frame", SAME_FRAME)
    cell: float | None = INPUT.length("Edge of a cell of both grids \\[m].", CELL)
    height: str = INPUT.choice(
        "Height of a cell: top, mean or shoalest, as of `export`. top is the mean of its uppermost surface.",
        HEIGHTS,
    )
    min_seen: int = INPUT.option("N", "Count points that at least N scans saw.", 1, min=1)


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    target: Target,
    other: Annotated[
        Path | None, typer.Argument(help="Another map, in place of --level.", metavar="[OTHER]", show_default=False)
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Compute cut and fill to a plane or another map, with sigmas.

    Cut is what lies above the plane, or was lost; fill what is missing below it, or was gained. Surfaces are compared
    where both were seen; the area that only one of two maps shows is printed beside.
    """
    from sonarmap.tools.products.export.grid import default_cell
    from sonarmap.tools.products.volume import volume_between, volume_to_level

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
            "of these nothing is known"
        )


def _opened(path: Path, least: int) -> "PlacedMap":
    """The largest part of a map, with the points that so many scans saw."""
    from sonarmap.tools.products.section import PlacedMap

    placed = PlacedMap.of(open_map(path))
    if not placed.upright:
        say(f"no instrument measured which way is up in {path}; heights are along the z axis of its frame")
    return placed.seen_by(least)
