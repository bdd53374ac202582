"""Options that say where a map lies on the Earth; the same for every verb."""

from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import EARTH, completes

if TYPE_CHECKING:
    from sonarmap.tools.files.geo.georeference import Georeference


def _verticals(incomplete: str) -> list[str]:
    from sonarmap.tools.files.geo.georeference import VERTICALS  # imports SciPy, which the help can do without

    return completes(VERTICALS)(incomplete)


OriginOption = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON[,HEIGHT]",
        help="Where the map's origin is: WGS84 \\[deg]. The height is above the vertical reference \\[m].",
        rich_help_panel=EARTH,
        show_default="as the map says",
    ),
]
OriginHeadingOption = Annotated[
    float | None,
    typer.Option(
        "--origin-heading",
        metavar="DEG",
        help="True heading of the map's x axis. It is for a map without a heading of its own.",
        rich_help_panel=EARTH,
        hidden=True,
        show_default="90, East",
    ),
]
VerticalOption = Annotated[
    str | None,
    typer.Option(
        "--vertical",
        metavar="NAME",
        help="What heights count from. Names: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or "
        "EGM2008. ",
        rich_help_panel=EARTH,
        hidden=True,
        show_default="surface",
        autocompletion=_verticals,
    ),
]
CrsOption = Annotated[
    str | None,
    typer.Option(
        "--crs",
        metavar="CRS",
        help="Projected coordinates of exported files, as EPSG:25832.",
        rich_help_panel=EARTH,
        hidden=True,
        show_default="the UTM zone of the origin",
    ),
]


def georeference_of(
    origin: str | None, heading: float | None, vertical: str | None, known: "Georeference | None" = None
) -> "Georeference | None":
    """What --origin, --origin-heading and --vertical say; None without an origin.

    Args:
        origin, heading, vertical: the options.
        known: of the map so far; what no option says stays as it is.

    Raises:
        InputError: numbers that cannot be an origin, or another option without any origin.
    """
    from dataclasses import replace

    from sonarmap.tools.files.geo.georeference import DEFAULT_VERTICAL, EAST, Georeference

    if origin is None and known is None:
        for name, value in (("--origin-heading", heading), ("--vertical", vertical)):
            if value is not None:
                raise InputError(f"{name} has no effect without --origin; give it too, or leave it out")
        return None
    if known is None or origin is not None:
        latitude, longitude, height = _numbers(origin or "")
        unsaid = (DEFAULT_VERTICAL, EAST) if known is None else (known.vertical, known.heading)
        known = Georeference(latitude, longitude, height, *unsaid)
    return replace(known, vertical=vertical or known.vertical, heading=known.heading if heading is None else heading)


def _numbers(origin: str) -> tuple[float, float, float]:
    """Latitude, longitude [deg] and height [m], 0 where it is left out."""
    try:
        numbers = [float(part) for part in origin.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise InputError(
            f"--origin is {origin!r}; wanted latitude and longitude in degrees with decimal points, and perhaps a "
            "height in meters, as in --origin 60.3913,5.3221 or --origin=-33.8568,151.2153,2.5"
        )
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0
