"""What a spectral registration saw, step by step: one PNG."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.products.report.naming import plain_text
from sonarmap.tools.products.report.registration_view import RegistrationView, ScanView
from sonarmap.tools.products.report.small_png import write_png
from sonarmap.tools.products.report.spectrum_panels import draw_layers, draw_rotations, draw_spectrum, draw_translations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE, _DPI = (14.4, 9.4), 110
_LINE, _LONGEST = 160, 50  # characters of the headline's lines, and of a scan's name in it
# Okabe and Ito's blue and orange, which no kind of color blindness mixes up; what contradicts differs in shape, too.
_TARGET, _SOURCE, _CONTRADICTING = "#0072B2", "#E69F00", "#C40000"
# Strays must not stretch the panel: this share of a scan's points at either end of an axis may lie outside.
_TRIM = 0.005
_HEADROOM = 0.3
_NAME = 24  # characters of a scan's name in a legend
_LEGEND: dict[str, Any] = {"loc": "upper left", "fontsize": 9, "ncols": 2, "columnspacing": 1.0, "framealpha": 0.9}
_LAYERS_TEXT = (
    "The pattern turns with the scan and does not move\nwith it. Dashed: x and y of the target; in the source\n"
    "where the rotation that was found puts them."
)


def draw_registration(path: Path, view: RegistrationView) -> None:
    """Write a PNG of what the registration saw. The same view gives the same bytes.

    Raises InputError: the file cannot be written."""
    write_png(lambda: registration_figure(view), path)


def registration_figure(view: RegistrationView) -> "Figure":
    """The figure: six panels in two rows, the third of two discs, in the order of the registration's steps."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=_SIZE, dpi=_DPI, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    grid = figure.add_gridspec(2, 3, width_ratios=(1, 1, 1.03))
    _draw_before(figure.add_subplot(grid[0, 0]), view)
    draw_spectrum(figure.add_subplot(grid[0, 1]), view)
    whole = figure.add_subfigure(grid[0, 2])
    whole.suptitle(f"3  The same at {view.radius:.2g}/m, all directions", fontsize=12)
    whole.supxlabel(_LAYERS_TEXT, fontsize=10)
    draw_layers(tuple(whole.subplots(1, 2)), view)
    draw_rotations(figure.add_subplot(grid[1, 0]), view)
    draw_translations(figure.add_subplot(grid[1, 1]), view)
    _draw_after(figure.add_subplot(grid[1, 2]), view)
    figure.suptitle(_headline(view), fontsize=12)
    return figure


def _headline(view: RegistrationView) -> str:
    """Which scans these are, the result, and why it is believed or not; the reason holds the probability."""
    registration = view.registration
    source, target = (plain_text(cloud.name, _LONGEST) for cloud in (view.source, view.target))
    yaw, pitch, roll = registration.T_target_source.rotation.as_euler("ZYX", degrees=True)
    x, y, z = registration.T_target_source.translation
    verdict = "Accepted" if registration.accepted else "NOT accepted"
    pose = f"yaw {yaw:+.1f}°, roll {roll:+.1f}°, pitch {pitch:+.1f}°;  x {x:+.2f} m, y {y:+.2f} m, z {z:+.2f} m"
    scans = f"The source, {source}, in the frame of the target, {target}"
    return "\n".join([scans, f"{verdict}:  {pose}", *textwrap.wrap(registration.reason, _LINE)])


def _draw_before(axes: "Axes", view: RegistrationView) -> None:
    """Both scans as they were seen, each in its own frame."""
    axes.set_title("1  Before: the scans from above, as they came")
    labels = [_label("target", view.target.name), _label("source", view.source.name)]
    _draw_both(axes, view, RigidTransform.identity(), labels)
    _mark_sensor(axes, np.zeros(3), "black", "both sensors")
    axes.legend(**_LEGEND)


def _draw_after(axes: "Axes", view: RegistrationView) -> None:
    """The source moved onto the target, and the points of either that stand before what the other saw."""
    T = view.registration.T_target_source
    axes.set_title("6  After: the source moved onto the target")
    _draw_both(axes, view, T, ["target", "source"])
    target, source = view.target, view.source
    against = np.vstack([target.points[target.contradicting], T.apply(source.points[source.contradicting])])
    share = len(against) / (len(target.points) + len(source.points))
    axes.plot(*against[:, :2].T, "x", color=_CONTRADICTING, markersize=2, markeredgewidth=0.4, alpha=0.7, zorder=4)
    axes.plot([], [], "x", color=_CONTRADICTING, label=f"the other saw through: {share:.1%}")
    _mark_sensor(axes, np.zeros(3), _TARGET, "sensors")
    _mark_sensor(axes, T.translation, _SOURCE, "")
    axes.legend(**_LEGEND)


def _draw_both(axes: "Axes", view: RegistrationView, T_target_source: RigidTransform, labels: list[str]) -> None:
    """Both scans in the target's frame."""
    moved = T_target_source.apply(view.source.points)
    _draw(axes, view.target, view.target.points, Rotation.identity(), _TARGET, labels[0])
    _draw(axes, view.source, moved, T_target_source.rotation, _SOURCE, labels[1])
    ends = [np.quantile(points[:, :2], [_TRIM, 1 - _TRIM], axis=0) for points in (view.target.points, moved)]
    low = np.minimum(np.min([end[0] for end in ends], axis=0), 0.0)
    high = np.maximum(np.max([end[1] for end in ends], axis=0), 0.0)
    half, (x, y) = 0.54 * (high - low).max(), (low + high) / 2
    # above the scans there is room for the legend
    room = _HEADROOM * half
    axes.set_xlim(x - half - room / 2, x + half + room / 2)
    axes.set_ylim(y - half, y + half + room)
    axes.set_aspect("equal")
    axes.set(xlabel="x, forward of the target's sensor [m]", ylabel="y, left [m]")
    axes.grid(alpha=0.25)


def _draw(axes: "Axes", cloud: ScanView, points: np.ndarray, R: Rotation, color: str, label: str) -> None:
    """One scan; what lies, as the bed, is pale, so that what stands upon it is seen."""
    lying = cloud.lying(R)
    look: dict[str, Any] = {"color": color, "markersize": 1.6, "markeredgewidth": 0}
    axes.plot(*points[lying, :2].T, ".", alpha=0.15, **look)
    axes.plot(*points[~lying, :2].T, ".", alpha=0.6, zorder=3, **look)
    axes.plot([], [], "o", color=color, label=label)


def _mark_sensor(axes: "Axes", place: np.ndarray, color: str, label: str) -> None:
    look: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "markeredgewidth": 0.8, "linestyle": "none"}
    axes.plot(*place[:2], marker="^", color=color, label=label, zorder=5, **look)


def _label(role: str, name: str) -> str:
    """Role and name of a scan as one short line of text: a dollar sign begins no formula."""
    return role if name == role else f"{role}: {plain_text(name, _NAME)}"
