"""Panels of the spectra and of the two correlations."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.products.report.correlation_maps import TranslationSlice, tilt_of, yaw_of
from sonarmap.tools.products.report.registration_view import RegistrationView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLORS = "viridis"
# Shares of a spectrum's magnitudes that the darkest and the brightest color stand for.
_DARKEST, _BRIGHTEST = 0.05, 0.998
_CHOSEN = "#FF4D4D"
_BOX: dict[str, Any] = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": "none", "alpha": 0.88}
_BAR: dict[str, Any] = {"fraction": 0.046, "pad": 0.03}
# Half the edge of the magnified part of the slice [voxels], and its share of the panel.
_NEAR, _SHARE = 8, 0.36


def draw_spectrum(axes: "Axes", view: RegistrationView) -> None:
    """The horizontal slice of the target's magnitude spectrum, on a logarithmic scale."""
    from matplotlib.patches import Circle

    axes.set_title("2  Magnitude spectrum of the target, $k_z$ = 0")
    shown, half = np.log10(np.maximum(view.spectrum, 1e-6)), view.frequency
    image = axes.imshow(shown.T, origin="lower", extent=(-half, half, -half, half), cmap=_COLORS, **_contrast(shown))
    axes.add_patch(Circle((0, 0), view.radius, fill=False, color="white", linestyle="--", linewidth=1.2))
    axes.annotate("rim of 3", (0, view.radius), (0, 4), textcoords="offset points", ha="center", color="white")
    axes.set(xlabel="$k_x$ [1/m]", ylabel="$k_y$ [1/m]")
    axes.figure.colorbar(image, ax=axes, label="logarithm of the magnitude, base 10", **_BAR)


def draw_layers(panels: tuple["Axes", "Axes"], view: RegistrationView) -> None:
    """Target's and source's magnitudes of one frequency, over the hemisphere of directions seen from its pole.

    The target's vertical planes through x and y are drawn into both: into the source's where the rotation that was
    found puts them.
    """
    R = view.registration.T_target_source.rotation
    around = np.linspace(0, 2 * np.pi, 361)[:, None]
    for axes, layer, title, turn in zip(
        panels, view.layers, ("of the target", "of the source"), (R.inv() * R, R.inv()), strict=True
    ):
        shown = np.log10(np.maximum(layer, 1e-6))
        limits = _contrast(shown[~np.isnan(shown)])
        axes.imshow(shown.T, origin="lower", extent=(-90, 90, -90, 90), cmap=_COLORS, **limits)
        for name, axis in zip("xy", np.eye(3), strict=False):
            arc = turn.apply(np.cos(around) * axis + np.sin(around) * [0, 0, 1])
            axes.plot(*_unwrapped(arc).T, color="white", linewidth=0.9, linestyle="--")
            end = turn.apply(axis)
            # of an axis that points below the horizon the other end is seen
            seen, name = (end, name) if end[2] > -1e-9 else (-end, f"-{name}")
            place = 103 * seen[:2] / max(np.linalg.norm(seen[:2]), 1e-9)
            axes.text(place[0], place[1], name, ha="center", va="center", fontsize=11, clip_on=False)
        axes.set_title(title, fontsize=10, pad=16)
        axes.set(xticks=(-90, 0, 90), yticks=(), xlabel="from vertical [°]", anchor="N")
        axes.set_xticklabels(("90", "0", "90"))
        axes.spines[:].set_visible(False)


def _unwrapped(directions: np.ndarray) -> np.ndarray:
    """Where directions (n, 3) are on the disc (n, 2) [deg]; NaN below the horizon."""
    polar = np.rad2deg(np.arccos(np.clip(directions[:, 2] / np.linalg.norm(directions, axis=1), -1, 1)))
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    places = polar[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    return np.where(polar[:, None] <= 90.0001, places, np.nan)


def draw_rotations(axes: "Axes", view: RegistrationView) -> None:
    """For each yaw and tilt the highest value over all rotations; the ones that were followed, and the chosen one."""
    turns, R = view.turns, view.registration.T_target_source.rotation
    axes.set_title("4  How alike the spectra are, over all rotations")
    axes.set_facecolor("0.85")
    image = axes.pcolormesh(turns.yaws, turns.tilts, 100 * turns.values, cmap=_COLORS, rasterized=True)
    followed = np.rad2deg([yaw_of(view.followed), tilt_of(view.followed)])
    ring: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "linestyle": "none"}
    axes.plot(*followed, markersize=6, markeredgecolor="white", label=f"{followed.shape[1]} verified", **ring)
    place = np.rad2deg([float(yaw_of(R)), float(tilt_of(R))])
    answer = "chosen" if view.registration.accepted else "best of them"
    label = f"{answer}: yaw {place[0]:+.1f}°, tilt {place[1]:.1f}°"
    axes.plot(*place, markersize=13, markeredgecolor=_CHOSEN, markeredgewidth=2.2, label=label, **ring)
    axes.set(xlabel="yaw of the source [°]", ylabel="tilt: angle between the two verticals [°]")
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= turns.tilts[-1]])
    # above the map there is room for the legend
    axes.set(xticks=range(-180, 181, 60), ylim=(0, 1.2 * turns.tilts[-1]), box_aspect=1)
    axes.legend(loc="upper left", fontsize=9, labelcolor="white", facecolor="0.3", framealpha=1.0)
    axes.figure.colorbar(image, ax=axes, label="correlation [% of two equal scans']", **_BAR)


def draw_translations(axes: "Axes", view: RegistrationView) -> None:
    """The translation's correlation at the height of its peak, and its surroundings magnified."""
    shifts = view.shifts
    axes.set_title(f"5  How alike the scans are, over all shifts at z = {shifts.z:+.1f} m")
    look: dict[str, Any] = {"cmap": _COLORS, "vmin": 0.0, "vmax": float(shifts.heights.max()), "rasterized": True}
    image = axes.pcolormesh(shifts.x, shifts.y, shifts.heights.T, **look)
    ring: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "markeredgecolor": _CHOSEN, "linestyle": "none"}
    axes.plot(*shifts.place, markersize=13, markeredgewidth=2.2, **ring)
    axes.set_aspect("equal")
    axes.set(xlabel="x of the source's sensor [m]", ylabel="y of the source's sensor [m]")
    axes.figure.colorbar(image, ax=axes, label="standard deviations above the mean", **_BAR)
    middle = np.array([shifts.x[[0, -1]].mean(), shifts.y[[0, -1]].mean()])
    right, up = (shifts.place > middle).tolist()
    near = _magnify(axes, shifts, look, (0.03 if right else 0.97 - _SHARE, 0.03 if up else 0.97 - _SHARE))
    near.plot(*view.registration.T_target_source.translation[:2], "+", color=_CHOSEN, markersize=9, markeredgewidth=2)
    x, y = shifts.place
    text = f"peak x {x:+.1f} m, y {y:+.1f} m\npeak-to-sidelobe ratio {shifts.psr:.0f}\n+ the pose, refined"
    # neither upon the magnified part, which is across, nor upon the peak: of the two other corners the one beside it
    # along the axis on which it is farther from the middle
    away = np.abs(shifts.place - middle)
    across = bool(away[0] >= away[1])
    left, top = (right, up) if across else (not right, not up)
    sides: dict[str, Any] = {"ha": "left" if left else "right", "va": "top" if top else "bottom"}
    corner = (0.03 if left else 0.97, 0.97 if top else 0.03)
    axes.text(*corner, text, transform=axes.transAxes, fontsize=9, bbox=_BOX, zorder=6, **sides)


def _magnify(axes: "Axes", shifts: TranslationSlice, look: dict[str, Any], corner: tuple[float, float]) -> "Axes":
    """The peak's surroundings, at a corner of the panel, given in its shares."""
    near = axes.inset_axes((*corner, _SHARE, _SHARE))
    near.pcolormesh(shifts.x, shifts.y, shifts.heights.T, **look)
    half = _NEAR * (shifts.x[1] - shifts.x[0])
    for limits, place in zip((near.set_xlim, near.set_ylim), shifts.place, strict=True):
        limits(place - half, place + half)
    near.set(xticks=(), yticks=())
    near.spines[:].set_color("white")
    near.text(0.04, 0.93, f"{2 * half:.3g} m", color="white", transform=near.transAxes, va="top", fontsize=9)
    axes.indicate_inset_zoom(near, edgecolor="white", alpha=0.8)
    return near


def _contrast(shown: np.ndarray) -> dict[str, Any]:
    low, high = np.quantile(shown, [_DARKEST, _BRIGHTEST])
    return {"vmin": float(low), "vmax": float(high)}
