"""`sonarmap accept`: whether a map meets an order of IHO S-44, as a page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import INPUT, OUTPUT, REQUIRED, JsonOption, QuietOption, checked
from sonarmap.tools.command.output import open_map
from sonarmap.tools.command.terminal import print_json, print_result, warn
from sonarmap.tools.products.accept.orders import ORDERS

NOT_MET = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """Options of what the map has to meet."""

    order: str = INPUT.option(
        "ORDER",
        f"Order of S-44: {', '.join(ORDERS)}.",
        REQUIRED,
        callback=checked(ORDERS.__contains__, f"{{!r}}; choose one of {', '.join(ORDERS)}"),
    )
    cell: float | None = INPUT.length("Edge of a cell \\[m].", "the smallest feature that the order asks to detect")
    datum_position_sigma: float | None = INPUT.length(
        "Standard deviation of East and of North that all fixes share \\[m].", "none"
    )
    datum_depth_sigma: float | None = INPUT.length(
        "Standard deviation of the depths' zero, as of a tide gauge \\[m].", "none"
    )


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    demand: Demand,
    out: Path = OUTPUT.option("FILE.html", "The page.", Path("acceptance.html"), "-o", "--out"),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check a finished MAP against an order of IHO S-44: a page with what meets it, where it fails and why.

    Every cell has a depth with its total vertical and horizontal uncertainty. The exit code is 0 if the order is met, 3
    if it is not, 2 for bad input: the map needs priors of attitude, heading, depth and position.
    """
    from sonarmap.tools.products.accept.page import write_sheet
    from sonarmap.tools.products.accept.sheet import sheet_of

    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"-o is {out}; wanted a name that ends in .html")
    datum = demand.datum_position_sigma or 0.0, demand.datum_depth_sigma or 0.0
    sheet = sheet_of(open_map(source), demand.order, demand.cell, datum)
    write_sheet(sheet, out)
    if as_json:
        print_json({**sheet.to_json(), "file": out})
    elif not quiet:
        for key, verdict in sheet.verdicts.items():
            state = "met" if sheet.meets(key) else "not met"
            print_result(f"{verdict.order.title}: {state}; {100 * verdict.share:.1f} % of the cells meet it")
        print_result(sheet.sentence)
        print_result(f"written to {out}; depths are below {sheet.depths}")
    for warning in sheet.warnings:
        warn(f"the map: {warning}")
    if not sheet.meets(demand.order):
        raise typer.Exit(NOT_MET)
