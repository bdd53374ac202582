"""The option that draws what a registration saw."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kernels.errors import InputError
from tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from spectral.prepare.spectral_scan import SpectralScan
    from spectral.result import Registrar, Registration


def _check_name(path: Path | None) -> Path | None:
    if path is None or path.suffix.lower() == ".png":
        return path
    raise typer.BadParameter(f"{path}; the picture is a PNG. Give a name that ends in .png, as --picture pair.png.")


PictureOption = Annotated[
    Path | None,
    typer.Option(
        "--picture",
        metavar="FILE.png",
        help=f"Draw what the registration saw, step by step; of --method {DEFAULT_METHOD}.",
        callback=_check_name,
    ),
]


def require_steps(picture: Path | None, method: str) -> None:
    """Refuse a picture of a method that has no such steps.

    Raises:
        InputError: saying so.
    """
    if picture is not None and method != DEFAULT_METHOD:
        raise InputError(
            f"--picture shows the steps of --method {DEFAULT_METHOD}, and --method {method} takes others; drop "
            f"--picture, or use --method {DEFAULT_METHOD}"
        )


def draw_picture(
    path: Path, registrar: "Registrar", target: "SpectralScan", source: "SpectralScan", registration: "Registration"
) -> None:
    """Draw a registration of DEFAULT_METHOD.

    Raises:
        InputError: the file cannot be written, or the registrar is of another method.
        DeviceError: the device cannot hold one correlation more.
    """
    from spectral.registration import SpectralRegistrar
    from tools.report.registration_picture import draw_registration
    from tools.report.registration_view import view_registration

    if not isinstance(registrar, SpectralRegistrar):
        raise InputError(f"a picture is of a SpectralRegistrar; this is a {type(registrar).__name__}")
    draw_registration(path, view_registration(registrar, target, source, registration))
