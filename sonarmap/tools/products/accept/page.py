"""The acceptance sheet as one HTML page, which needs no network, no script and no other file."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.accept.orders import STANDARD
from sonarmap.tools.products.accept.sheet import REASONS, Sheet
from sonarmap.tools.products.report.page import base64_text, escaped, joined, part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WEB = "sonarmap.tools.products.accept.web"
_WIDTH, _TALLEST, _DPI = 7.5, 9.0, 110  # of a picture [in, in, 1/in]
# Of Okabe and Ito's colors, for the color-blind: cells that meet the order, and the reasons in their order
_COLORS = ("#009E73", "#D55E00", "#E69F00", "#CC79A7", "#56B4E9", "#0072B2", "#000000")
_HIGHEST = 0.98  # quantile of the TVU at the end of its color scale


def write_sheet(sheet: Sheet, path: Path) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(sheet_text(sheet), encoding="utf-8")


def sheet_text(sheet: Sheet) -> str:
    """HTML of the page."""
    met = sheet.meets(sheet.asked)
    return Template(part(_WEB, "sheet.html")).substitute(
        joined([(_WEB, "sheet.css")], []),
        title=escaped(f"Acceptance sheet: {sheet.folder.path.resolve().name}"),
        result="met" if met else "not met",
        state="met" if met else "failed",
        sentence=escaped(sheet.sentence),
        facts=_rows(_facts(sheet)),
        orders=_rows(_orders(sheet)),
        terms=_rows(_terms(sheet)),
        crossings=_rows(_crossings(sheet)),
        warnings="".join(f"<li>{escaped(warning)}</li>" for warning in sheet.warnings or ["none"]),
        reasons=base64_text(_png(_reasons_map(sheet))),
        uncertainty=base64_text(_png(_uncertainty_map(sheet))),
    )


def _rows(rows: Sequence[Sequence[str]]) -> str:
    """Rows of a table; the first cell of each is its heading."""
    return "\n".join(
        f"<tr><th>{escaped(head)}</th>{''.join(f'<td>{escaped(cell)}</td>' for cell in cells)}</tr>"
        for head, *cells in rows
    )


def _facts(sheet: Sheet) -> list[list[str]]:
    cells, verdict = sheet.cells, sheet.verdict
    return [
        ["order asked for", f"{verdict.order.title}, {STANDARD}"],
        ["strictest order met", sheet.verdicts[sheet.best].order.title if sheet.best else "none"],
        ["depths", f"{cells.depth.min():.2f} to {cells.depth.max():.2f} m below {sheet.depths}"],
        ["cells", f"{len(cells.depth):,} of {cells.cell:g} m, with {int(cells.soundings.sum()):,} soundings"],
        ["coverage", f"{100 * verdict.coverage:.1f} % of the area that soundings enclose"],
        ["holes", f"{int(verdict.holes.sum()):,} cells"],
    ]


def _orders(sheet: Sheet) -> list[list[str]]:
    return [
        [
            verdict.order.title,
            f"{100 * verdict.share:.1f} %",
            *(f"{np.median(limit):.2f} m" for limit in verdict.limits),
            f"{100 * verdict.order.coverage:.0f} %",
            "yes" if sheet.meets(key) else "no",
        ]
        for key, verdict in sheet.verdicts.items()
    ]


def _terms(sheet: Sheet) -> list[list[str]]:
    failing = {**sheet.verdict.failing, "TVU": sum(sheet.verdict.failing.values())}
    sizes = {**sheet.cells.terms, "position": sheet.cells.thu, "TVU": sheet.cells.tvu}
    said = {name: [f"{size:.2f} m" for size in np.quantile(sizes[name], (0.5, 0.95)).tolist()] for name in sizes}
    meanings = {**REASONS, "TVU": "all vertical terms together; cells that fail for any reason"}
    return [
        [name, meaning, *said.get(name, ["", ""]), f"{100 * failing[name]:.1f} %"] for name, meaning in meanings.items()
    ]


def _crossings(sheet: Sheet) -> list[list[str]]:
    each = sheet.crossings
    rows = {
        f"two scans, median distance ({each.pairs} crossings)": (each.observed_m, each.predicted_m),
        "two lines, standard deviation": (each.lines_observed_m, each.lines_predicted_m),
    }
    return [
        [name, *("not known" if value is None else f"{value:.3f} m" for value in pair)] for name, pair in rows.items()
    ]


def _reasons_map(sheet: Sheet) -> "Figure":
    """Map of the cells that meet the order, and of the others by their reason."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    verdict = sheet.verdict
    figure, axes, grid, extent = _map(sheet, verdict.reason)
    grid[verdict.holes] = len(REASONS) - 1
    limits = {"vmin": -1.5, "vmax": len(REASONS) - 0.5}
    axes.imshow(grid, cmap=ListedColormap(_COLORS), **limits, **extent)
    names = [f"meets {verdict.order.title}", *(f"fails: {name}" for name in REASONS)]
    shown = (np.unique(grid[np.isfinite(grid)]).astype(int) + 1).tolist()
    axes.legend(handles=[Patch(color=_COLORS[k], label=names[k]) for k in shown], loc="best", fontsize=9)
    return figure


def _uncertainty_map(sheet: Sheet) -> "Figure":
    figure, axes, grid, extent = _map(sheet, sheet.cells.tvu)
    image = axes.imshow(grid, vmin=0.0, vmax=float(np.quantile(sheet.cells.tvu, _HIGHEST)), **extent)
    figure.colorbar(image, label="TVU, 95 % [m]", extend="max")
    return figure


def _map(sheet: Sheet, values: np.ndarray) -> tuple["Figure", Any, np.ndarray, dict[str, Any]]:
    """A figure, its axes, the cells' values (K,) as a grid, and the options to draw it from above."""
    from matplotlib.figure import Figure

    cells, (rows, columns) = sheet.cells, sheet.verdict.holes.shape
    grid = np.full((rows, columns), np.nan)
    grid[cells.row, cells.column] = values
    figure = Figure(figsize=(_WIDTH, min(_TALLEST, 0.8 * _WIDTH * rows / columns + 1)), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot(aspect="equal", xlabel="East [m]", ylabel="North [m]")
    (west, south), (east, north) = cells.cell * cells.low, cells.cell * (cells.low + np.array([columns, rows]))
    return figure, axes, grid, {"extent": (west, east, south, north), "origin": "lower", "interpolation": "nearest"}


def _png(figure: "Figure") -> bytes:
    file = BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
