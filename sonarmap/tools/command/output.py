"""Options for a map's folder, export formats and place on the Earth; opening and exporting of maps."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import EARTH, OUTPUT, REQUIRED, refuse_without
from sonarmap.tools.command.terminal import growing_progress, say
from sonarmap.tools.files.writers.atomic import locked
from sonarmap.tools.products.export.formats import FORMATS, known_formats

if TYPE_CHECKING:
    from sonarmap.tools.files.geo import Georeference, Projection
    from sonarmap.tools.files.map_folder.folder import Map
    from sonarmap.tools.products.export.run import Exported, ExportSettings

CELL = "two voxels, rounded up"  # to 1, 2 or 5 times a power of ten: the default of --cell


def _check_formats(values: list[str] | None) -> list[str] | None:
    """Format names, split at commas, without duplicates."""
    try:
        return known_formats(name for value in values or () for name in value.split(","))
    except InputError as error:
        raise typer.BadParameter(str(error)) from error


FormatsOption = Annotated[
    list[str],
    OUTPUT.value(
        "NAME",
        f"Formats, as laz,geotiff,kmz: {', '.join(FORMATS)}.",
        callback=_check_formats,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class MapOutput:
    """Options of a map's folder, its report and its exports."""

    out: Path = OUTPUT.option("OUT", "Folder for the results.", REQUIRED, "-o", "--out")
    report: bool = OUTPUT.flag(
        "--report/--no-report", "Write report.html, the page that `sonarmap view OUT` opens.", True, rare=True
    )
    export: FormatsOption = field(default_factory=list[str])

    def export_settings(
        self, crs: str | None, georeference: "Georeference | None", stamps: "Sequence[float]", later: bool = False
    ) -> "ExportSettings":
        """Settings of --export and --crs. Exports that would fail once the map is made are refused now; `later`: the
        navigation, which is not read yet, may give the map's place on the Earth."""
        from sonarmap.tools.products.export.run import ExportSettings, check_files, check_settings

        formats = self.export
        if crs is not None and not formats:
            raise InputError("--crs has no effect without --export; leave it out, or name a format")
        settings = ExportSettings(tuple(formats), crs)
        check_settings(settings, georeference, stamps, later)
        check_files(settings, self.out)
        return settings


def export_with_progress(folder: "Map", to: Path, settings: "ExportSettings", quiet: bool) -> "Exported":
    """Export a map, and print the notes about it."""
    from sonarmap.tools.products.export.run import export_map

    with growing_progress("exporting", quiet) as step:
        exported = export_map(folder, to, settings, step)
    for note in exported.notes:
        say(note)
    return exported


@dataclass(frozen=True, slots=True)
class EarthPlace:
    """Options of the map's origin and of the coordinates of exported files."""

    origin: str | None = EARTH.option(
        "LAT,LON[,HEIGHT]",
        "The map's origin: WGS84 \\[deg], or EPSG:CODE:E,N[,HEIGHT]. Heights are above the vertical reference \\[m].",
        shown="the map's own",
    )
    origin_heading: float | None = EARTH.option(
        "DEG", "True heading of the x axis of a map without a heading of its own.", rare=True, shown="90, East"
    )
    vertical: str | None = EARTH.option(
        "NAME",
        "Vertical reference of heights: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or EGM2008.",
        rare=True,
        shown="surface",
    )
    crs: str | None = EARTH.option(
        "CRS",
        "CRS of exported files, e.g. EPSG:25832; map: points and grids in the map's own frame.",
        rare=True,
        shown="the UTM zone of the origin",
    )

    def georeference(self, known: "Georeference | None" = None) -> "Georeference | None":
        """The map's place by --origin, --origin-heading and --vertical; the rest is taken from `known`. None without an
        origin."""
        from sonarmap.tools.files.geo import DEFAULT_VERTICAL, EAST, Georeference

        if self.origin is None and known is None:
            refuse_without("--origin", {"--origin-heading": self.origin_heading, "--vertical": self.vertical})
            return None
        if known is None or self.origin is not None:
            defaults = (DEFAULT_VERTICAL, EAST) if known is None else (known.vertical, known.heading)
            known = Georeference(*_place_of(self.origin or ""), *defaults)
        heading = known.heading if self.origin_heading is None else self.origin_heading
        return replace(known, vertical=self.vertical or known.vertical, heading=heading)

    def projection(self, known: "Georeference | None") -> "Projection | None":
        """The projection to --crs at the map's place; None if the place is not known."""
        from sonarmap.tools.files.geo import Projection

        if known is not None:
            return Projection.of(known, self.crs)
        if self.crs is not None:
            raise InputError("--crs has no effect on a map whose place is not known; give --origin too")
        return None


def _place_of(origin: str) -> tuple[float, float, float]:
    """Latitude, longitude [deg] and height [m] of --origin; without a height it is 0."""
    from sonarmap.tools.files.geo import on_the_earth
    from sonarmap.tools.files.readers.csv_table import number, place_of

    crs, _, rest = origin.rpartition(":")
    projected = re.match(r"\s*\+?[A-Za-z]{2}", crs)  # N60:23.478 begins with one letter
    numbers = [*map(number, rest.split(","))] if projected else place_of(origin)
    usable = len(numbers) in (2, 3) and all(map(math.isfinite, numbers))
    if not usable or not (projected or (abs(numbers[0]) <= 90 and abs(numbers[1]) <= 180)):
        raise InputError(
            f"--origin is {origin!r}; wanted latitude and longitude in degrees, the latitude first, and perhaps a "
            "height in meters, as in --origin 60.3913,5.3221 or --origin=-33.8568,151.2153,2.5 or --origin "
            '"60 23.478 N, 5 19.326 E" or, with decimal commas, --origin "60,3913; 5,3221"; or a CRS, easting and '
            "northing in meters, as in --origin EPSG:32632:297400,6700600"
        )
    first, second, height = [*numbers, 0.0][:3]
    if not projected:
        return first, second, height
    latitude, longitude = on_the_earth([[first, second, height]], crs.strip(), "--origin")[0, :2].tolist()
    return latitude, longitude, height


SAME_FRAME = "Do not register: both maps have one frame, on the Earth if placed there, else their own."


def open_map(path: Path, earth: EarthPlace | None = None) -> "Map":
    """Read a map; of several parts the largest is used, and a message says so."""
    from sonarmap.tools.files.map_folder.folder import read_map_folder

    with locked(path, writing=False):
        folder = read_map_folder(path)
    if len(folder.parts) > 1:
        say(f"{path} has {len(folder.parts)} parts; using the largest")
    return folder if earth is None else replace(folder, georeference=earth.georeference(folder.georeference))
