"""Where a map lies on the Earth: the same options for every verb."""

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import EARTH, completes, listed_in, option, refuse_without

if TYPE_CHECKING:
    from sonarmap.tools.files.geo.georeference import Georeference

_earth = partial(option, EARTH)


@dataclass(frozen=True, slots=True)
class EarthPlace:
    """Where the map's origin is, and the coordinates of exported files."""

    origin: str | None = _earth(
        "LAT,LON[,HEIGHT]",
        "Where the map's origin is: WGS84 \\[deg]. The height is above the vertical reference \\[m].",
        shown="as the map says",
    )
    origin_heading: float | None = _earth(
        "DEG",
        "True heading of the map's x axis. It is for a map without a heading of its own.",
        rare=True,
        shown="90, East",
    )
    vertical: str | None = _earth(
        "NAME",
        "What heights count from. Names: surface (the water's, during the survey), MSL, ellipsoid, EGM96 or EGM2008. ",
        rare=True,
        shown="surface",
        autocompletion=completes(listed_in("sonarmap.tools.files.geo.georeference", "VERTICALS")),
    )
    crs: str | None = _earth(
        "CRS", "Projected coordinates of exported files, as EPSG:25832.", rare=True, shown="the UTM zone of the origin"
    )

    def georeference(self, known: "Georeference | None" = None) -> "Georeference | None":
        """What --origin, --origin-heading and --vertical say; what none of them says stays as `known` has it.

        None without an origin. Raises InputError: numbers that cannot be one, or another option without any origin.
        """
        from sonarmap.tools.files.geo.georeference import DEFAULT_VERTICAL, EAST, Georeference

        if self.origin is None and known is None:
            refuse_without("--origin", {"--origin-heading": self.origin_heading, "--vertical": self.vertical})
            return None
        if known is None or self.origin is not None:
            unsaid = (DEFAULT_VERTICAL, EAST) if known is None else (known.vertical, known.heading)
            known = Georeference(*_numbers(self.origin or ""), *unsaid)
        heading = known.heading if self.origin_heading is None else self.origin_heading
        return replace(known, vertical=self.vertical or known.vertical, heading=heading)


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
