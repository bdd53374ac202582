"""What a spectral registration saw, step by step: one PNG."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.products.report.naming import plain_text
from sonarmap.tools.products.report.registration_view import RegistrationView
from sonarmap.tools.products.report.scan_panels import draw_after, draw_before
from sonarmap.tools.products.report.small_png import write_png
from sonarmap.tools.products.report.spectrum_panels import draw_layers, draw_rotations, draw_spectrum, draw_translations

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE, _DPI = (14.4, 9.4), 110
_LINE, _LONGEST = 160, 50  # characters of the headline's lines, and of a scan's name in it


_LAYERS_TEXT = (
    "The pattern turns with the scan and does not move\nwith it. Dashed: x and y of the target; in the source\n"
    "where the rotation that was found puts them."
)


def draw_registration(path: Path, view: RegistrationView) -> None:
    """Write a PNG of what the registration saw. The same view gives the same bytes.

    Raises:
        InputError: the file cannot be written.
    """
    write_png(lambda: registration_figure(view), path)


def registration_figure(view: RegistrationView) -> "Figure":
    """The figure: six panels in two rows, the third of two discs, in the order of the registration's steps."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=_SIZE, dpi=_DPI, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    grid = figure.add_gridspec(2, 3, width_ratios=(1, 1, 1.03))
    draw_before(figure.add_subplot(grid[0, 0]), view)
    draw_spectrum(figure.add_subplot(grid[0, 1]), view)
    whole = figure.add_subfigure(grid[0, 2])
    whole.suptitle(f"3  The same at {view.radius:.2g}/m, all directions", fontsize=12)
    whole.supxlabel(_LAYERS_TEXT, fontsize=10)
    draw_layers(tuple(whole.subplots(1, 2)), view)
    draw_rotations(figure.add_subplot(grid[1, 0]), view)
    draw_translations(figure.add_subplot(grid[1, 1]), view)
    draw_after(figure.add_subplot(grid[1, 2]), view)
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
