"""Pictures as PNG files: a map from above with its track."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import maximum_filter

from sonarmap.kernels.counted import counted
from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo import EAST, VERTICALS, Georeference
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.report.provenance import plain_text, survey_date, survey_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHTS, _BESIDE, _DPI = 8.0, (3.0, 11.0), (2.2, 1.7), 140  # width, range of heights, margins of the map [in]
_COLORS = "viridis"  # perceptually uniform, also in gray prints and for the color-blind; as in the report
# Those of Okabe and Ito's colors that differ from the map's; surveys after the fifth repeat them
_TRACKS = ("#D55E00", "#000000", "#CC79A7", "#E69F00", "#56B4E9")
_DOT = 1.5  # edge of a dot [voxels]: points lie anywhere in their voxels, and surfaces should show no gaps
_CELLS = 1200  # largest number of cells along an axis
_STRAY, _MARGIN = 0.002, 0.05  # share of the points at either end that may lie outside; share of the extent as margin
_EXTREMES, _FLAT = (0.01, 0.99), 0.5  # quantiles at the ends of the color scale; its smallest range [voxels]
_LONGEST = 60  # characters of a name in the title
_MARK: dict[str, Any] = {"linestyle": "none", "color": "white", "markeredgecolor": _TRACKS[0], "markeredgewidth": 1.8}


def draw_map(
    path: Path, result: SurveyResult, rank: int, inputs: Sequence[str], georeference: Georeference | None = None
) -> None:
    """Write a PNG of map number `rank`, 1 for the largest, seen from above; `inputs` are its files or folders."""
    write_png(map_figure(result, rank, inputs, georeference), path)


def map_figure(
    result: SurveyResult, rank: int, inputs: Sequence[str], georeference: Georeference | None = None
) -> "Figure":
    """Figure with the uppermost points, colored by depth or height, and the track of each survey."""
    from matplotlib.figure import Figure

    c = placed(result.components)[rank - 1]
    point_map, track = result.maps[c], result.trajectory.take(result.components[c])
    unmeasured = _unmeasured(result, c)
    here = georeference if _on_earth(result, c, georeference) else None
    lower, upper = _extent(point_map.points[:, :2], track.T_world_sensor.translation[:, :2])
    width, height = (upper - lower).tolist()
    tall = float(np.clip(_WIDTH * height / width, *_HEIGHTS))
    figure = Figure(figsize=(_WIDTH + _BESIDE[0], tall + _BESIDE[1]), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal")
    axes.set_title("\n".join(_title(result, rank, inputs, track, point_map)))
    known = (unmeasured is not None and "heading" not in unmeasured) or (here is not None and here.heading == EAST)
    axes.set(xlabel="East [m]" if known else "x [m]", ylabel="North [m]" if known else "y [m]")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
    levels = _levels(unmeasured, georeference, here)
    _draw_points(axes, point_map, *levels)
    _draw_track(axes, track.T_world_sensor.translation, [result.surveys[k] for k in result.components[c]])
    figure.legend(loc="outside lower left", ncols=4, frameon=False)
    if here is not None:
        ahead = "" if known else f", and x points to {here.heading:g}° (clockwise from North)"
        figure.supxlabel(f"The origin is at {here.latitude:.7f}, {here.longitude:.7f} (WGS84){ahead}.", fontsize=10)
    return figure


def _title(result: SurveyResult, rank: int, inputs: Sequence[str], track: Trajectory, point_map: PointMap) -> list[str]:
    """Lines of the title: name, date and part of the survey; numbers of scans and points, and the voxel."""
    parts = len(placed(result.components))
    of_parts = f"part {rank} of {parts}" if parts > 1 else ""
    called = plain_text(survey_name(inputs), _LONGEST), survey_date(track.stamps), of_parts
    scans, points = counted(len(track), "scan"), counted(len(point_map.points), "point")
    return [", ".join(filter(None, called)) or "Map", f"{scans}, {points}, voxel {point_map.voxel:.3g} m"]


def _extent(points: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2,) lower and upper corner of the view [m]: the track, and all points but strays."""
    ends = np.vstack([np.quantile(points, (_STRAY, 1 - _STRAY), axis=0), places])
    lower, upper = ends.min(axis=0), ends.max(axis=0)
    margin = max(_MARGIN * float((upper - lower).max()), 0.25)
    return lower - margin, upper + margin


def _draw_points(axes: "Axes", point_map: PointMap, words: str, zero: float | None) -> None:
    """Draw the highest point of each cell as an image, with a scale of depths below `zero`, if any, or heights."""
    limits = np.array([axes.get_ylim(), axes.get_xlim()])
    lower, spans = limits[:, 0], np.diff(limits)[:, 0]
    cell = max(point_map.voxel / 2, float(spans.max()) / _CELLS)
    shape = np.maximum(1, spans / cell).astype(int)
    z = point_map.points[:, 2]
    cells = np.floor((point_map.points[:, 1::-1] - lower) / spans * shape).astype(int)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    highest = np.full(shape, -np.inf)
    np.maximum.at(highest, tuple(cells[inside].T), z[inside])
    highest = maximum_filter(highest, max(1, round(_DOT * point_map.voxel / cell)), mode="constant", cval=-np.inf)
    highest[np.isneginf(highest)] = np.nan
    low, high = np.quantile(z, _EXTREMES) if zero is None else zero - np.quantile(z, _EXTREMES)[::-1]
    lacking = max(0.0, _FLAT * point_map.voxel - (high - low)) / 2
    image = axes.imshow(
        highest if zero is None else zero - highest,
        cmap=_COLORS if zero is None else f"{_COLORS}_r",
        vmin=low - lacking,
        vmax=high + lacking,
        extent=(*limits[1], *limits[0]),
        origin="lower",
        interpolation="nearest",
    )
    bar = axes.figure.colorbar(image, ax=axes, extend="both", label=words)
    if zero is not None:
        bar.ax.invert_yaxis()


def _draw_track(axes: "Axes", places: np.ndarray, surveys: list[int]) -> None:
    numbers = sorted(set(surveys))
    for k, number in enumerate(numbers):
        leg = places[np.equal(surveys, number)]
        name = "track of the sensor" if len(numbers) == 1 else f"survey {number}"
        color = _TRACKS[k % len(_TRACKS)]
        axes.plot(*leg[:, :2].T, color=color, linewidth=1.3, label=f"{name}, {counted(len(leg), 'scan')}")
    axes.plot(*places[0, :2], marker="o", markersize=10, label="start", **_MARK)
    axes.plot(*places[-1, :2], marker="s", markersize=5.5, label="end", **_MARK)


def _levels(
    unmeasured: tuple[str, ...] | None, georeference: Georeference | None, here: Georeference | None
) -> tuple[str, float | None]:
    """Label of the color scale, and the height from which depths count; None to show heights."""
    if (unmeasured is None or "up" in unmeasured) and (here is None or here.height == 0):
        return "height relative to the first scan [m]", None
    if georeference is None:
        return "depth below the zero of the navigation's heights [m]", 0.0
    return f"depth below {VERTICALS[georeference.vertical]} [m]", -georeference.height


def _on_earth(result: SurveyResult, c: int, georeference: Georeference | None) -> bool:
    """Whether instruments place the component on the Earth, or the origin does: the largest, if they place none."""
    maps = placed(result.components)
    lone = c == maps[0] and all(_unmeasured(result, each) != () for each in maps)
    return georeference is not None and (lone or _unmeasured(result, c) == ())


def _unmeasured(result: SurveyResult, c: int) -> tuple[str, ...] | None:
    """Names of MEASURED that no instrument measured for a component; None if it is not in the world."""
    graph, members = result.solution.graph, result.components[c]
    if {pose for pose, _ in graph.priors}.union(known.pose for known in graph.known).isdisjoint(members):
        return None
    free = graph.gauge.unmeasured.get(members[0], np.zeros(len(MEASURED), dtype=bool))
    return tuple(name for name, unknown in zip(MEASURED, free, strict=True) if unknown)


def write_png(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG; the same figure gives the same bytes."""
    with warnings.catch_warnings(), atomic_path(path) as temporary:
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # characters without a glyph are drawn as boxes
        figure.savefig(temporary, format="png")
