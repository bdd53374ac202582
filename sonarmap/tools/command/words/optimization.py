"""What `sonarmap optimize` prints: the rejected edges, the verdict, and the numbers behind it."""

import math
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.terminal import print_result, print_rows, result_console

MOST_REJECTED = 20  # rows that the table lists
_USUAL = 3.0  # standard deviations of chi-squared within which a graph is consistent


def print_optimized(report: dict[str, Any], robust: bool, out: Path) -> None:
    """The optimized graph in words, by the report that --json prints; `robust` if wrong edges were looked for."""
    rejected = [loop for loop in report["loops"] if loop["verdict"] == "rejected"]
    if rejected:
        _print_rejected(rejected)
    print_result(verdict(report, robust))
    print_rows(_rows(report, rejected if robust else None))
    print_result(f"written to {out}")


def verdict(report: dict[str, Any], robust: bool) -> str:
    """Whether the poses fit the edges, in a sentence."""
    chi_squared, freedom = report["chi_squared_after"], report["degrees_of_freedom"]
    numbers = f"chi-squared is {chi_squared:.4g}, about {freedom} is usual"
    if not report["converged"]:
        return f"Not converged: after {report['iterations']} iterations the poses are the best so far, not the optimum."
    if freedom == 0:
        return "There is nothing that could contradict: every pose follows from one edge."
    beyond = (chi_squared - freedom) / math.sqrt(2 * freedom)
    if beyond > _USUAL:
        advice = "their sigmas may be too small" if robust else "--robust finds wrong edges and leaves them out"
        return f"The edges contradict each other more than their sigmas allow: {numbers}; {advice}."
    if beyond < -_USUAL:
        return f"The poses fit the edges, better than their sigmas say: {numbers}."
    return f"The poses fit the edges: {numbers}."


def _rows(report: dict[str, Any], rejected: list[dict[str, Any]] | None) -> dict[str, str]:
    loops = sum(loop["kind"] == "loop" for loop in report["loops"])
    return {
        "graph": f"{report['poses']:,} poses, {report['edges']:,} edges, {loops:,} of them loops",
        **({} if rejected is None else {"rejected": f"{len(rejected):,} edges, left out" if rejected else "no edge"}),
        "cost": f"{report['cost_before']:.6g} before, {report['cost_after']:.9g} after {report['iterations']} "
        f"iterations from the {report['start']} start ({report['objective']} objective)",
        "chi-squared": f"{report['chi_squared_before']:.6g} before, {report['chi_squared_after']:.6g} after; "
        f"{report['degrees_of_freedom']} degrees of freedom",
        "certificate": _certificate(report["certificate"]),
        **({"compared": _distance(report["distance"])} if report["distance"] else {}),
    }


def _certificate(certificate: dict[str, Any]) -> str:
    gap = f" (gap {certificate['gap']:.2g})" if certificate["gap"] is not None else ""
    reason = as_options(certificate["reason"])
    return f"none: {reason}" if certificate["verdict"] == "none" else reason + gap


def _distance(distance: dict[str, Any]) -> str:
    if "reason" in distance:
        return f"not with the {distance['to']} objective: {as_options(distance['reason'])}"
    return (
        f"the solution of the {distance['to']} objective is {distance['translation_rms_m']:.3g} m and "
        f"{distance['rotation_rms_deg']:.3g}° away (root mean square; at most "
        f"{distance['translation_max_m']:.3g} m and {distance['rotation_max_deg']:.3g}°)"
    )


def _print_rejected(rejected: list[dict[str, Any]]) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("rejected edge", no_wrap=True)
    table.add_column("kind", no_wrap=True)
    table.add_column("sigmas", justify="right", no_wrap=True)
    table.add_column("reason")
    for loop in sorted(rejected, key=lambda loop: -loop["sigmas"])[:MOST_REJECTED]:
        table.add_row(f"{loop['i']} - {loop['j']}", loop["kind"], f"{loop['sigmas']:,.1f}", Text(loop["reason"]))
    result_console().print(table)
    if len(rejected) > MOST_REJECTED:
        print_result(f"and {len(rejected) - MOST_REJECTED} more; --json lists all")
    print_result("")
