"""The files of a comparison, all or none: changed regions as JSON, table and picture, and every core point."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path, locked, require_writable
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.tables import write_json, write_table
from sonarmap.tools.products.compare.comparison import Comparison
from sonarmap.tools.products.compare.detection import Distances, Region, Verdict
from sonarmap.tools.products.export.geotiff import NODATA
from sonarmap.tools.products.export.grid import check_size
from sonarmap.tools.products.report.pictures import write_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _BESIDE, _HEIGHTS, _DPI = 7.6, (2.4, 1.6), (3.0, 10.0), 140  # width, margins, range of heights of the axes [in]
_TEXT, _LINE_LENGTH = 9.0, 110  # [pt]; characters of a line below the title
_COLORS, _UNKNOWN, _INK = "RdBu", "#B8B8B8", "#000000"
_LARGEST = 0.98  # quantile of significant distances at the ends of the color scale
_LISTED = 12  # largest number of regions labeled with their volume
PREFIX = "changes"  # of the files' names
_COLUMNS = ("number", "kind", "area_m2", "height_m", "volume_m3", "volume_sigma_m3", "core_points", "x_m", "y_m", "z_m")
_WORLD = ("easting_m", "northing_m")


def changes_figure(comparison: Comparison) -> "Figure":
    """Map of the distances, in x and y of the old map's frame, with the changed regions."""
    from matplotlib.figure import Figure

    distances, points = comparison.distances, comparison.distances.cores.points
    extent = np.maximum(np.ptp(points[:, :2], axis=0), distances.voxel)
    tall = float(np.clip(_WIDTH * extent[1] / extent[0], *_HEIGHTS))
    figure = Figure(figsize=(_WIDTH + _BESIDE[0], tall + _BESIDE[1]), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal", adjustable="datalim")
    # a core point is about a voxel wide
    size = (72 * min(_WIDTH / extent[0], tall / extent[1]) * distances.voxel) ** 2
    known, most = _colored(distances)
    unknown = points[~known]
    axes.scatter(
        unknown[:, 0], unknown[:, 1], size, _UNKNOWN, edgecolor="none", rasterized=True, label="unsure or unseen"
    )
    order = np.flatnonzero(known)[np.argsort(points[known, 2], kind="stable")]
    x, y = points[order, :2].T
    dots = axes.scatter(x, y, size, distances.distance[order], cmap=_COLORS, vmin=-most, vmax=most)
    dots.set(edgecolor="none", rasterized=True)
    _outline(axes, comparison)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="upper right", fontsize=_TEXT, markerscale=2)
    figure.colorbar(dots, ax=axes, extend="both", label="distance along the normal [m]: gained positive, lost negative")
    first, *more = str(comparison).splitlines()
    count = len(comparison.regions)
    figure.suptitle(f"{count} changed region{'' if count == 1 else 's'}")
    below = f"{first.rpartition(': ')[2]}; {'; '.join(line.strip() for line in more)}"
    axes.set_title(textwrap.fill(below, _LINE_LENGTH), fontsize=_TEXT)
    return figure


def _colored(distances: Distances) -> tuple[np.ndarray, float]:
    """Which core points are decided and have a color, (K,) bool; and the largest distance of the color scale [m]."""
    known = np.isfinite(distances.distance) & (distances.verdict != Verdict.UNSURE)
    beyond = np.isin(distances.verdict, (Verdict.GAINED, Verdict.LOST))
    shown = np.abs(distances.distance[beyond if beyond.any() else known])
    return known, max(float(np.quantile(shown, _LARGEST)) if len(shown) else 0.0, 1e-3)


def _outline(axes: "Axes", comparison: Comparison) -> None:
    """Draw a frame around each region, with its number and, for the largest, its volume."""
    from matplotlib.patches import Rectangle

    margin = comparison.distances.voxel
    for number, region in enumerate(comparison.regions, 1):
        low, wide = region.low[:2] - margin, region.high[:2] - region.low[:2] + 2 * margin
        axes.add_patch(Rectangle((low[0], low[1]), wide[0], wide[1], fill=False, edgecolor=_INK, linewidth=1.0))
        words = f"{number}: {region.volume:+,.1f} ± {region.sigma:.1f} m³" if number <= _LISTED else str(number)
        axes.annotate(words, (low[0], low[1] + wide[1]), (0, 2), textcoords="offset points", fontsize=_TEXT - 1)


def check_folder(out: Path, *maps: Path) -> None:
    """Refuse a map's folder, whose files `map` writes, and a folder that cannot be written."""
    for folder in maps:
        if out.resolve() == folder.resolve():
            raise InputError(f"-o {out} is a map's folder, whose files `map` writes; choose another folder")
    require_writable(out)


def write_comparison(
    out: Path, comparison: Comparison, place: tuple[Georeference, Projection] | None
) -> Sequence[Path]:
    """Write a comparison into a folder and return the files; `place` is that of the old map on the Earth."""
    distances, regions = comparison.distances, comparison.regions
    columns = _columns(distances, regions)
    with locked(out, writing=True), all_or_none() as written:
        world = None if place is None else _projected(distances.cores.points, *place)
        write_ply(out / f"{PREFIX}.ply", distances.cores.points, columns)
        _write_regions(out / f"{PREFIX}.csv", regions, place)
        write_png(changes_figure(comparison), out / f"{PREFIX}.png")
        if world is not None and place is not None:
            _write_geotiff(out / f"{PREFIX}.tif", world, distances, place[1])
        files = [path.name for _, path in written] + [f"{PREFIX}.json"]
        write_json(out / f"{PREFIX}.json", {**comparison.as_json, "files": files})
        return [path for _, path in written]


def _columns(distances: Distances, regions: Sequence[Region]) -> dict[str, np.ndarray]:
    """Columns of the core points, {name: (K,)}."""
    region = np.zeros(len(distances.verdict), np.uint16)
    for number, each in enumerate(regions, 1):
        region[each.members] = number
    return {
        "distance": distances.distance.astype(np.float32),
        "level": distances.level.astype(np.float32),
        "verdict": distances.verdict.astype(np.uint8),
        "region": region,
    }


def _projected(points: np.ndarray, georeference: Georeference, projection: Projection) -> np.ndarray:
    """(K, 3) easting, northing, height [m]."""
    return projection.project(georeference.geodetic(points))


def _write_regions(path: Path, regions: Sequence[Region], place: tuple[Georeference, Projection] | None) -> None:
    """Write one row per region, lengths to 1 mm."""
    rows: list[list[object]] = []
    for number, region in enumerate(regions, 1):
        fields = region.as_json
        numbers = [*(fields[name] for name in _COLUMNS[2:6])]
        where = region.place.tolist()
        if place is not None:
            where += _projected(region.place[None], *place)[0, :2].tolist()
        texts = [f"{value:z.3f}" for value in numbers], [f"{value:z.3f}" for value in where]
        rows.append([number, fields["kind"], *texts[0], len(region.members), *texts[1]])
    write_table(path, (*_COLUMNS, *(_WORLD if place else ())), rows)


def _write_geotiff(path: Path, world: np.ndarray, distances: Distances, projection: Projection) -> None:
    """Write distance (band 1), distance over its standard deviation (2) and verdict (3) of the uppermost core point in
    each cell of one voxel; north up."""
    import rasterio

    cell = distances.voxel
    place = np.floor(world[:, :2] / cell).astype(np.int64)
    left, top = int(place[:, 0].min()), int(place[:, 1].max()) + 1
    row, column = top - 1 - place[:, 1], place[:, 0] - left
    rows, columns = int(row.max()) + 1, int(column.max()) + 1
    check_size(rows, columns, cell)
    values = np.full((3, rows, columns), NODATA, np.float32)
    order = np.argsort(world[:, 2], kind="stable")  # the last of a cell's points is written, the highest
    bands = np.stack([distances.distance, distances.distance / distances.sigma, distances.verdict.astype(np.float64)])
    values[:, row[order], column[order]] = np.nan_to_num(bands[:, order], nan=NODATA)
    profile: dict[str, Any] = {"driver": "GTiff", "dtype": "float32", "count": 3, "nodata": NODATA}
    profile |= {"compress": "deflate", "predictor": 3, "tiled": True, "bigtiff": "if_safer"}
    profile |= {"crs": rasterio.CRS.from_wkt(projection.crs.to_wkt()), "height": rows, "width": columns}
    profile["transform"] = rasterio.Affine(cell, 0, left * cell, 0, -cell, top * cell)
    with atomic_path(path) as temporary, rasterio.open(temporary, "w", **profile) as raster:
        raster.write(values)
        raster.descriptions = (
            "distance",
            "distance over its sigma",
            ", ".join(f"{v} {v.name.lower()}" for v in Verdict),
        )
        raster.units = ("m", "sigmas", "class")
        raster.update_tags(SIGN="positive where the surface was gained")
