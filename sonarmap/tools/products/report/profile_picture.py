"""The track from its start to its end: depths, overlaps, and how sure the poses are. One PNG."""

import itertools
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.products.report.labels import shrink
from sonarmap.tools.products.report.small_png import write_png
from sonarmap.tools.products.report.survey.profile import Profile, profile_of
from sonarmap.tools.products.report.survey.track import number_step
from sonarmap.tools.products.report.survey.view import PartView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE, _DPI = (11.7, 8.3), 140  # A4 landscape
_TEXT, _TITLE = 10.0, 17.0  # [pt]
_LEFT, _END = 0.1, 0.975  # of the panels [figure's width]
_SENSOR, _BED, _HORIZONTAL, _VERTICAL, _LOST = "#D55E00", "#0072B2", "#0072B2", "#E69F00", "#000000"
_MARKED = 60  # scans of which each gets a dot
_ROOM, _ABOVE, _NAMES = 1.35, 0.13, 0.1  # above the curves for the legend, and for the surveys' names
_LEAST = 4.0  # range of depths that is shown at least [voxels]


def draw_profile(path: Path, view: PartView) -> None:
    """Write a PNG of the profile along the track of a part. The same view gives the same bytes.

    Raises InputError: the file cannot be written."""
    write_png(lambda: profile_figure(view), path, (_SENSOR, _BED, _VERTICAL))


def profile_figure(view: PartView) -> "Figure":
    """The figure: depths, overlaps, sigmas of the place and of the heading, one below the other."""
    from matplotlib.figure import Figure

    profile = profile_of(view)
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    panels: list[Axes] = figure.subplots(4, 1, sharex=True, height_ratios=(3.2, 1.3, 1.3, 1.3)).tolist()
    figure.subplots_adjust(left=_LEFT, right=_END, bottom=0.08, top=0.83, hspace=0.12)
    title = f"{view.title}: along the track" if view.title else "Along the track"
    for height, words, size, weight in (
        (0.945, title, _TITLE, "bold"),
        (0.912, f"{view.size}. Sigmas are {view.frame.sigmas}.", _TEXT + 0.5, "normal"),
    ):
        shrink(figure.text(_LEFT, height, words, fontsize=size, weight=weight), (_END - _LEFT) * figure.bbox.width)
    for axes in panels:
        axes.grid(color="0.6", alpha=0.35, linewidth=0.6)
        axes.tick_params(labelsize=_TEXT)
    _draw_depths(panels[0], view, profile)
    _draw_overlaps(panels[1], profile)
    _draw_sigmas(panels[2], profile, profile.sigmas[:2], "m", ("horizontal, worst direction", "vertical"))
    _draw_sigmas(panels[3], profile, profile.sigmas[2:], "°", ("heading",))
    for axes, start in itertools.product(panels, profile.starts):
        axes.axvline(_between(profile.along, start), color="0.4", linewidth=0.9, linestyle=(0, (4, 3)))
    margin = 0.01 * max(float(np.ptp(profile.along)), 1e-6)
    panels[-1].set_xlim(profile.along[0] - margin, profile.along[-1] + margin)
    panels[-1].set_xlabel(profile.axis, fontsize=_TEXT)
    _number_scans(panels[0], view, profile)
    if profile.starts:
        _name_surveys(panels[0], view, profile)
    figure.align_ylabels(panels)
    return figure


def _draw_depths(axes: "Axes", view: PartView, profile: Profile) -> None:
    deep, middle, shallow = _broken(profile.bed, profile.starts)
    along, vehicle = _broken(np.stack([profile.along, profile.vehicle]), profile.starts)
    dots: dict[str, Any] = {"marker": "o", "markersize": 2.5} if len(view.scans) <= _MARKED else {}
    axes.plot(along, vehicle, color=_SENSOR, linewidth=1.5, label="sensor", **dots)
    if np.isfinite(middle).any():
        axes.plot(along, middle, color=_BED, linewidth=1.3, label="points under the sensor: median", **dots)
        axes.fill_between(along, deep, shallow, color=_BED, alpha=0.25, linewidth=0, label="10 % to 90 % of them")
    else:
        axes.plot([], [], " ", label="no points of the map lie under the sensor")
    if profile.loop_ends:
        ends = profile.along[list(profile.loop_ends)]
        mark: dict[str, Any] = {"color": "0.35", "markersize": 7, "markeredgewidth": 0.7, "clip_on": False}
        label = f"ends of loops, {len(ends)} scans"
        axes.plot(ends, np.full(len(ends), 0.015), "|", transform=axes.get_xaxis_transform(), label=label, **mark)
    axes.set_ylabel(textwrap.fill(view.frame.height, 32), fontsize=_TEXT)
    _limit_levels(axes, np.concatenate([profile.vehicle, profile.bed.ravel()]), view)
    _legend(axes, 4)


def _limit_levels(axes: "Axes", levels: np.ndarray, view: PartView) -> None:
    """Limits for levels [m], no closer than a few voxels, with room for the legend above; depths grow downward."""
    low, high = float(np.nanmin(levels)), float(np.nanmax(levels))
    span = max(1.1 * (high - low), _LEAST * view.point_map.voxel)
    middle, room = (low + high) / 2, (_ABOVE + _NAMES * (len(set(view.surveys)) > 1)) * span
    if view.frame.zero is None:
        axes.set_ylim(middle - span / 2, middle + span / 2 + room)
    else:
        axes.set_ylim(middle + span / 2, middle - span / 2 - room)


def _draw_overlaps(axes: "Axes", profile: Profile) -> None:
    kept, lost = profile.overlaps[profile.kept], profile.overlaps[~profile.kept]
    axes.plot(kept[:, 0], 100 * kept[:, 1], ".", color=_BED, markersize=4, label="overlap with the next scan")
    axes.vlines(kept[:, 0], 0, 100 * kept[:, 1], color=_BED, alpha=0.3, linewidth=0.8)
    if len(lost):
        axes.plot(lost[:, 0], 100 * lost[:, 1], "x", color=_LOST, markersize=6, label=f"not kept, {len(lost)}")
    axes.set_ylabel("overlap [%]", fontsize=_TEXT)
    axes.set(ylim=(0, 100 * _ROOM), yticks=(0, 50, 100))
    _legend(axes, 2)


def _draw_sigmas(axes: "Axes", profile: Profile, sigmas: np.ndarray, unit: str, names: Sequence[str]) -> None:
    """Standard deviations (k, n) from zero on; the second is dashed."""
    along, *curves = _broken(np.vstack([profile.along, sigmas]), profile.starts)
    looks = (_HORIZONTAL, "-"), (_VERTICAL, (0, (5, 1.5)))
    for curve, name, (color, line) in zip(curves, names, looks, strict=False):
        axes.plot(along, curve, color=color, linewidth=1.3, linestyle=line, label=name)
    axes.set_ylabel(f"sigma [{unit}]", fontsize=_TEXT)
    axes.set_ylim(0, _ROOM * max(float(sigmas.max()), 1e-6))
    _legend(axes, len(names))


def _legend(axes: "Axes", columns: int) -> None:
    look: dict[str, Any] = {"frameon": True, "framealpha": 0.85, "edgecolor": "none", "borderpad": 0.2}
    axes.legend(loc="upper left", ncols=columns, fontsize=_TEXT - 1, borderaxespad=0.2, **look)


def _number_scans(axes: "Axes", view: PartView, profile: Profile) -> None:
    """The numbers of some scans above the panel, and the surveys' names."""
    step = number_step(len(view.scans))
    chosen, last = [], -np.inf
    apart = 0.045 * max(float(np.ptp(profile.along)), 1e-6)
    for k, scan in enumerate(view.scans):
        if scan % step == 0 and profile.along[k] - last >= apart:
            chosen.append(k)
            last = profile.along[k]
    above = axes.secondary_xaxis("top")
    above.set_xticks(profile.along[chosen], [str(view.scans[k]) for k in chosen], fontsize=_TEXT)
    above.set_xlabel("number of the scan", fontsize=_TEXT)


def _name_surveys(axes: "Axes", view: PartView, profile: Profile) -> None:
    """Each survey's name where it begins, as far as its part of the panel is long enough."""
    edges = [axes.get_xlim()[0], *(_between(profile.along, start) for start in profile.starts), axes.get_xlim()[1]]
    for first, begin, end in zip((0, *profile.starts), edges[:-1], edges[1:], strict=True):
        place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        name, look = view.survey_names[view.surveys[first]], {"fontsize": _TEXT - 1, "color": "0.25", "va": "top"}
        text = axes.annotate(name, (begin, 1.0), xytext=(4, -19), **place, **look)
        room = axes.transData.transform([(begin, 0), (end, 0)])[:, 0]
        if text.get_window_extent().x1 > room[1]:
            text.remove()


def _between(along: np.ndarray, start: int) -> float:
    return float(along[start - 1] + along[start]) / 2


def _broken(rows: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
    """(r, n + s) rows (r, n) with a gap before each start."""
    return np.insert(rows, starts, np.nan, axis=1)
