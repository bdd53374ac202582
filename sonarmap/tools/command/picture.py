"""The option --picture, which draws a registration."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import OUTPUT
from sonarmap.tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from sonarmap.spectral.prepare.spectral_scan import SpectralScan
    from sonarmap.spectral.result import Registrar, Registration


def _check_name(path: Path | None) -> Path | None:
    if path is None or path.suffix.lower() == ".png":
        return path
    raise typer.BadParameter(
        f"{path}; the picture is a PNG file. Give a name that ends in .png, as in --picture pair.png."
    )


PictureOption = Annotated[
    Path | None,
    typer.Option(
        "--picture",
        metavar="FILE.png",
        help=f"Draw the registration step by step; only with --method {DEFAULT_METHOD}.",
        callback=_check_name,
        rich_help_panel=OUTPUT,
    ),
]


def require_steps(picture: Path | None, method: str) -> None:
    """Refuse a picture of another method than DEFAULT_METHOD.

    Raises:
        InputError: there is a picture to draw, and the method is another.
    """
    if picture is not None and method != DEFAULT_METHOD:
        raise InputError(
            f"--picture draws the steps of --method {DEFAULT_METHOD}, and --method {method} has other steps; leave "
            f"--picture out, or use --method {DEFAULT_METHOD}"
        )


def draw_picture(
    path: Path, registrar: "Registrar", target: "SpectralScan", source: "SpectralScan", registration: "Registration"
) -> None:
    """Draw a registration of DEFAULT_METHOD.

    Raises:
        InputError: the file cannot be written, or the registrar is another.
        DeviceError: the device cannot hold one more correlation.
    """
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.products.report.registration_picture import draw_registration
    from sonarmap.tools.products.report.registration_view import view_registration

    if not isinstance(registrar, SpectralRegistrar):
        raise InputError(f"only a SpectralRegistrar can be drawn; this is a {type(registrar).__name__}")
    draw_registration(path, view_registration(registrar, target, source, registration))
