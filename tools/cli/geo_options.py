"""Options that say where a map lies on the Earth; the same for every verb."""

from typing import TYPE_CHECKING, Annotated

import typer

from kernels.errors import InputError

if TYPE_CHECKING:
    from tools.geo.georeference import Georeference

OriginOption = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON[,HEIGHT]",
        help="Where the origin of the map is: degrees, WGS84, and meters above the vertical reference. \\[from "
        "navigation]",
    ),
]
OriginHeadingOption = Annotated[
    float | None,
    typer.Option(
        "--origin-heading",
        metavar="DEG",
        help="True compass heading of the map's x axis, for a map without a heading of its own. \\[90, East]",
    ),
]
VerticalOption = Annotated[
    str | None,
    typer.Option(
        "--vertical",
        metavar="NAME",
        help="What heights count from: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or EGM2008. "
        "\\[surface]",
    ),
]


def georeference_of(origin: str | None, heading: float | None, vertical: str | None) -> "Georeference | None":
    """What --origin, --origin-heading and --vertical say; None without an origin.

    Raises:
        InputError: numbers that cannot be an origin, or another option without --origin.
    """
    from tools.geo.georeference import DEFAULT_VERTICAL, EAST, Georeference

    if origin is None:
        for name, value in (("--origin-heading", heading), ("--vertical", vertical)):
            if value is not None:
                raise InputError(f"{name} has no effect without --origin; give it too, or leave it out")
        return None
    try:
        numbers = [float(part) for part in origin.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise InputError(
            f"--origin is {origin!r}; wanted latitude and longitude in degrees with decimal points, and perhaps a "
            "height in meters, as in --origin 60.3913,5.3221 or --origin=-33.8568,151.2153,2.5"
        )
    return Georeference(*numbers, vertical=vertical or DEFAULT_VERTICAL, heading=EAST if heading is None else heading)
