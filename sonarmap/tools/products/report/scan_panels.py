"""Panels with both scans from above, before and after their registration."""

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.products.report.naming import plain_text
from sonarmap.tools.products.report.registration_view import RegistrationView, ScanView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's blue and orange, which no kind of color blindness mixes up; what contradicts differs in shape, too.
_TARGET, _SOURCE, _CONTRADICTING = "#0072B2", "#E69F00", "#C40000"
# Strays must not stretch the panel: this share of a scan's points at either end of an axis may lie outside.
_TRIM = 0.005
_HEADROOM = 0.3
_LONGEST = 24


def draw_before(axes: "Axes", view: RegistrationView) -> None:
    """Both scans as they were seen, each in its own frame."""
    axes.set_title("1  Before: the scans from above, as they came")
    labels = [_label(role, cloud.name) for role, cloud in (("target", view.target), ("source", view.source))]
    _draw_both(axes, view, RigidTransform.identity(), labels)
    _mark_sensor(axes, np.zeros(3), "black", "both sensors")
    axes.legend(loc="upper left", fontsize=9, ncols=2, columnspacing=1.0, framealpha=0.9)


def draw_after(axes: "Axes", view: RegistrationView) -> None:
    """The source moved onto the target, and the points of either that stand before what the other saw."""
    T = view.registration.T_target_source
    axes.set_title("6  After: the source moved onto the target")
    _draw_both(axes, view, T, ["target", "source"])
    target, source = view.target, view.source
    against = np.vstack([target.points[target.contradicting], T.apply(source.points[source.contradicting])])
    share = len(against) / (len(target.points) + len(source.points))
    label = f"the other saw through: {share:.1%}"
    axes.plot(*against[:, :2].T, "x", color=_CONTRADICTING, markersize=2, markeredgewidth=0.4, alpha=0.7, zorder=4)
    axes.plot([], [], "x", color=_CONTRADICTING, label=label)
    _mark_sensor(axes, np.zeros(3), _TARGET, "sensors")
    _mark_sensor(axes, T.translation, _SOURCE, "")
    axes.legend(loc="upper left", fontsize=9, ncols=2, columnspacing=1.0, framealpha=0.9)


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
    look: dict[str, Any] = {
        "markersize": 8,
        "markeredgecolor": "white",
        "markeredgewidth": 0.8,
        "zorder": 5,
        "linestyle": "none",
    }
    axes.plot(*place[:2], marker="^", color=color, label=label, **look)


def _label(role: str, name: str) -> str:
    """Role and name of a scan as one short line of text: a dollar sign begins no formula."""
    if name == role:
        return role
    return f"{role}: {plain_text(name, _LONGEST)}"
