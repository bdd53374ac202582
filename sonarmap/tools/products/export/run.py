"""Export of a finished map to formats of other programs: all chosen files of all parts, or none."""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import EAST, VERTICALS, Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart, mapped_scans
from sonarmap.tools.files.map_folder.names import OF_ALL, earlier_files, side_car, write_summary
from sonarmap.tools.files.time_scales import are_times, utc_text
from sonarmap.tools.files.user_file import package_versions, sha256_of
from sonarmap.tools.files.writers.atomic import all_or_none, locked, require_writable
from sonarmap.tools.files.writers.tables import write_json
from sonarmap.tools.products.export.clouds import Cloud
from sonarmap.tools.products.export.formats import FORMATS
from sonarmap.tools.products.export.georeferenced import Georeferenced, MapGrid
from sonarmap.tools.products.export.grid import MANY_EMPTY, default_cell

MAP_FRAME = "map"  # as --crs names the map's own coordinates
_LIBRARIES = ("pyproj", "laspy", "lazrs", "rasterio", "pye57")
_FRAMES = {
    "projected": "easting, northing and height; every point is projected by itself",
    "geographic": "longitude, latitude and height",
}


@dataclass(frozen=True, slots=True)
class ExportSettings:
    formats: tuple[str, ...]  # names of FORMATS
    # projected CRS such as EPSG:25832; None for the UTM zone of the map's origin; MAP_FRAME for points and grids in the
    # map's frame
    crs: str | None = None
    cell: float | None = None  # edge of a cell of grids, pictures and meshes [m]; None for `default_cell`
    height: str = "top"  # kind of a cell's height, a name of HEIGHTS
    of_scans: bool = False  # whether files of points hold the points of all scans instead of the map's
    scans: tuple[int, ...] | None = None  # indices of these scans; None for all
    scans_from: tuple[str, ...] = ()  # files of the scans; empty for the inputs of `map`

    @property
    def projected(self) -> str | None:
        """The projected CRS; None for the default or the map's frame."""
        return None if self.crs == MAP_FRAME else self.crs

    @property
    def needing_place(self) -> tuple[str, ...]:
        """The formats that need the map's place on the Earth."""
        return tuple(name for name in self.formats if FORMATS[name].needs_place and not self.in_map_frame(name))

    def in_map_frame(self, name: str) -> bool:
        return self.crs == MAP_FRAME and FORMATS[name].fits_map_frame


@dataclass(frozen=True, slots=True)
class Exported:
    """Result of an export.

    Attributes:
        files: written files, each followed by its side-car.
        notes: remarks for the user, one sentence each.
        grids: for each grid `file`, `cell_m`, the `empty_share` of its covered cells, and `sufficient_cell_m`, the cell
            with at most 5 % of empty cells.
    """

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    grids: tuple[Mapping[str, Any], ...] = ()


_OF_GRID = ("cell_m", "empty_share", "sufficient_cell_m")  # keys of a grid's details


class NoPlaceError(InputError):
    """A format needs the map's place on the Earth, which is not known."""


def check_settings(
    settings: ExportSettings, georeference: Georeference | None, stamps: Sequence[float], later: bool = False
) -> None:
    """Refuse, before a map is computed, settings that its export could not satisfy; `stamps` are those of the scans
    [s], and `later` says whether a missing georeference may still become known."""
    _require_fitting(settings)
    for name in settings.formats:
        low, high, (first, end) = min(stamps, default=0.0), max(stamps, default=0.0), FORMATS[name].stamps  # [s]
        if stamps and not first <= low <= high < end:
            raise InputError(
                f"{name} needs stamps from {first:.0f} to {end:.0f} s, not {low:g} to {high:g}; leave this format out"
            )
    if georeference is not None:
        Projection.of(georeference, settings.projected)
    elif later:
        return
    elif settings.needing_place:
        fitting = any(FORMATS[name].fits_map_frame for name in settings.formats)
        raise NoPlaceError(
            f"it is not known where the map lies on the Earth, which {' and '.join(settings.needing_place)} "
            f"need{'s' if len(settings.needing_place) == 1 else ''}; give --origin LAT,LON[,HEIGHT]"
            f"{', or --crs map for points and grids in the frame of the map' if fitting else ''}"
        )
    elif settings.projected is not None:
        raise InputError("--crs has no effect on a map whose place is not known; give --origin too, or leave it out")


def _require_fitting(settings: ExportSettings) -> None:
    fitting = [name for name, form in FORMATS.items() if form.of_points]
    if (settings.of_scans or settings.scans is not None) and not set(fitting) & set(settings.formats):
        raise InputError(f"points of scans need a format of points; give one of {', '.join(fitting)}")
    other = [name for name in settings.needing_place if FORMATS[name].coordinates == "projected"]
    if settings.crs == MAP_FRAME and other:
        raise InputError(f"--crs map is not for {other[0]}, which is on the Earth; leave one of them out")


def check_files(settings: ExportSettings, out: Path) -> None:
    """Refuse, before a map is computed, an export over files that neither a map nor an export wrote."""
    names = [re.escape(file).replace(r"\{\}", r"(_\d+)?") for name in settings.formats for file in FORMATS[name].files]
    ours = {*earlier_files(out), *OF_ALL}
    for path in sorted(out.glob("*")):
        if path.name not in ours and re.fullmatch("|".join(names), path.name):
            _require_ours(path)


def export_map(
    folder: Map, to: Path, settings: ExportSettings, step: Callable[[int, int, str], None] | None = None
) -> Exported:
    """Write a map in the chosen formats, with a side-car beside every file, all together or none.

    Parts whose place on the Earth is not known are left out of formats that need it. Files of an earlier export are
    replaced. In the map's own folder files are listed in summary.json, so that the next `sonarmap map` removes them.
    The folder `to` is created if it is missing; `step` gets (files written, files in all, name of the next)."""
    stamps = [stamp for part in folder.parts for stamp in part.trajectory.stamps.tolist()]
    check_settings(settings, folder.georeference, stamps)
    _refuse_second_heading(folder)
    cell = settings.cell or default_cell(folder.voxel)

    def on_earth(part: MapPart) -> Georeferenced | None:
        if (here := folder.georeference) is None or not folder.on_earth(part):
            return None
        projection = Projection.of(here, settings.projected)
        return Georeferenced(folder, part, here, projection, cell=cell, height=settings.height)

    earths = {part.suffix: on_earth(part) for part in folder.parts}
    of_scans = settings.of_scans or settings.scans is not None
    jobs = [
        (name, part, to / FORMATS[name].name(part, of_scans))
        for name in settings.formats
        for part in folder.parts[: 1 if FORMATS[name].of_all_parts else None]
        if (earths[part.suffix] is not None or name not in settings.needing_place)
        and (len(part.points) or FORMATS[name].of_all_parts)
    ]
    require_writable(to)
    scans = mapped_scans(folder, settings.scans_from) if of_scans else None
    grids: list[dict[str, Any]] = []
    in_map = to.resolve() == folder.path.resolve()
    with nullcontext() if in_map else locked(to, writing=True), all_or_none() as written:
        for _, _, path in jobs:
            _require_ours(path)
        for done, (name, part, path) in enumerate(jobs):
            if step is not None:
                step(done, len(jobs), path.name)
            before, earth = len(written), None if settings.in_map_frame(name) else earths[part.suffix]
            local = MapGrid(folder, part, cell=cell, height=settings.height) if FORMATS[name].of_grid else None
            cloud = Cloud(folder, part, earth, scans, settings.scans)
            details = FORMATS[name].write(path, folder, part, earth or local, cloud, cell)
            if FORMATS[name].of_grid:
                grids.append({"file": path.name} | {key: details[key] for key in _OF_GRID})
            for temporary, final in tuple(written[before:]):
                _require_ours(final)
                content = side_car_content(temporary, final.name, name, folder, part, earth) | {"details": details}
                content |= {"points": details["points"]} if "points" in details else {}
                write_json(final.with_name(side_car(final.name)), content)
        if step is not None:
            step(len(jobs), len(jobs), "")
        files = tuple(path for _, path in written)
        if in_map:
            write_summary(to, folder.summary, [path.name for path in files])
    return Exported(files, (*_notes(folder, settings, earths), *map(_grid_note, grids)), tuple(grids))


def _grid_note(grid: Mapping[str, Any]) -> str:
    file, cell, share, sufficient = grid.values()
    larger = "" if sufficient == cell else f"; with --cell {sufficient:g} at most {MANY_EMPTY:.0%} are"
    return f"{file}: {share:.1%} of the cells within its coverage are empty{larger}"


def _refuse_second_heading(folder: Map) -> None:
    """Refuse --origin-heading for a map whose headings were measured: its x axis points East."""
    turned = folder.georeference is not None and folder.georeference.heading != EAST
    if turned and any(part.knows("heading") and folder.on_earth(part) for part in folder.parts):
        raise InputError("--origin-heading cannot be given for a map whose headings were measured; leave it out")


def _require_ours(path: Path) -> None:
    """Refuse to replace a file that is not an export, such as the map's own."""
    if path.exists() and not path.with_name(side_car(path.name)).exists():
        raise InputError(f"{path} exists and is no export ({side_car(path.name)} is missing); choose another folder")


def _notes(folder: Map, settings: ExportSettings, earths: dict[str, Georeferenced | None]) -> list[str]:
    """Remarks about the map's place, level, heights and heading."""
    notes: list[str] = []
    placed = [earth for earth in earths.values() if earth is not None and len(earth.part.points)]
    if settings.needing_place and len(placed) < len(earths):
        formats = ", ".join(settings.needing_place)
        lost = ", ".join(f"map{suffix}.ply" for suffix, earth in earths.items() if earth not in placed)
        notes.append(f"{lost}: the place on the Earth is not known; left out of {formats}")
    if not placed:
        return notes
    first, places = placed[0], np.concatenate([earth.points for earth in placed])
    if first.projection.crosses_zone(places):
        notes.append(f"the map lies in more than one UTM zone, or in another; all is in {first.projection.name}")
    elif settings.crs is not None and not first.projection.covers(places):
        notes.append(f"the map lies outside the area of use of {first.projection.name}")
    map_settings: dict[str, Any] = folder.summary.get("settings") or {}
    if map_settings.get("heights_from"):
        notes.append(
            "heights count from the transducer, whose draught the lines' files do not give: map again with --draught M"
        )
    part, here = first.part, first.georeference  # unmeasured values come from the origin or the first scan
    if not part.knows("tilt_x"):
        notes.append("no attitude was measured: the map is level if the sensor was so at its first scan")
    if not part.knows("up") and here.height == 0:
        notes.append(
            f"no depth was measured: heights count from the map's first scan, taken to be at the height of "
            f"{VERTICALS[here.vertical]}; give its height as in --origin {here.latitude:g},{here.longitude:g},-12.5"
        )
    if not part.knows("heading") and here.heading == EAST:
        notes.append("no heading was measured: the map's x axis is taken to point East; --origin-heading turns it")
    return notes


def side_car_content(
    written: Path, name: str, format_name: str, folder: Map, part: MapPart, earth: Georeferenced | None
) -> dict[str, Any]:
    """Side-car of an exported file: provenance, frame, datum, units and signs; the caller fills in `details`. The file
    is at `written` now and will be `name`."""
    kind = FORMATS[format_name]
    coordinates = "map" if earth is None else kind.coordinates
    return {
        "file": name,
        "format": format_name,
        "what": kind.words,
        "bytes": written.stat().st_size,
        "sha256": sha256_of(written),
        "written_by": package_versions(*_LIBRARIES),
        "frame": _frame(coordinates, part),
        **_place(coordinates, earth),
        "units": "m, s; degrees where a name says so, and for latitude and longitude",
        "signs": "height and z are positive up, a depth is positive down: depth_m = -height_m",
        "points": len(part.points),
        "scans": len(part.scans),
        "voxel_m": folder.voxel,
        "taken": _taken(part.trajectory.stamps),
        "details": {},
        "inputs": folder.summary.get("inputs", []),
        "map": {
            "part": f"{[each.suffix for each in folder.parts].index(part.suffix) + 1} of {len(folder.parts)}",
            "written_by": folder.summary.get("versions"),
            "settings": folder.summary.get("settings"),
        },
    }


def _frame(coordinates: str, part: MapPart) -> str:
    if coordinates in _FRAMES:
        return _FRAMES[coordinates]
    if part.placed:
        return "the map's: x East, y North, z up, from its origin"
    if part.in_world:
        return f"the map's: x East, y North, z up, but for what was not measured: {', '.join(part.unmeasured)}"
    return f"the map's: that of its first scan's sensor, x forward, y left, z up ({part.suffix or 'the largest part'})"


def _place(coordinates: str, earth: Georeferenced | None) -> dict[str, Any]:
    """Reference system of the file's coordinates, and the map's origin in WGS84."""
    if earth is None:
        return dict.fromkeys(("datum", "crs", "vertical_reference", "vertical_epsg", "origin"))
    from pyproj import CRS

    from sonarmap.tools.files.geo import WGS84

    here, crs = earth.georeference, earth.projection.crs_with_heights
    rows: dict[str, Any] = {"datum": "WGS84", "crs": None}
    if coordinates == "projected":
        datum = earth.projection.crs.datum
        rows = {
            "datum": None if datum is None else datum.name,
            "crs": {"name": crs.name, "epsg": earth.projection.crs.to_epsg(), "wkt": crs.to_wkt()},
        }
    elif coordinates == "geographic":
        geographic = CRS.from_epsg(WGS84)
        rows["crs"] = {"name": geographic.name, "epsg": WGS84, "wkt": geographic.to_wkt()}
    convergence = float(earth.projection.convergence(here.geodetic(np.zeros((1, 3))))[0])
    return {
        **rows,
        "vertical_reference": f"heights count from {VERTICALS[here.vertical]}",
        "vertical_epsg": earth.projection.vertical_epsg,
        "origin": {
            "latitude_deg": here.latitude,
            "longitude_deg": here.longitude,
            "height_m": here.height,
            "x_axis_true_heading_deg": here.heading % 360,
            "x_axis_grid_heading_deg": (here.heading - convergence) % 360,
            "grid_convergence_deg": convergence,
            "is": f"the zero of the map's frame; its y axis points to {(here.heading - EAST) % 360:g} degrees",
        },
    }


def _taken(stamps: np.ndarray) -> dict[str, Any]:
    if not are_times(stamps):
        return {"utc": None, "stamps_s": [float(stamps.min()), float(stamps.max())]}
    return {"utc": [utc_text(float(stamps.min())), utc_text(float(stamps.max()))]}
