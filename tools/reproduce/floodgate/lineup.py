"""Who makes maps of the flood gate: the paper's three methods, this project's, and what else is at hand."""

from collections.abc import Iterable
from dataclasses import dataclass
from types import MappingProxyType

EXTENT = 256.0  # of the paper's grids [m]
VOXEL = 2.0  # of methods without a grid of their own [m]


@dataclass(frozen=True, slots=True)
class Entrant:
    """A method of the comparison.

    Attributes:
        title: what it does, in words.
        on_grids: whether it runs once on each of the paper's grids.
        color: in the figures.
        mark: in the figures.
        in_figures: whether the maps and motions are drawn; those of the paper's methods and this project's.
    """

    title: str
    on_grids: bool
    color: str
    mark: str
    in_figures: bool = True


TRUTH = "true poses"

# Name, as `build` of tools/methods/registry.py knows it -> entrant, in the order of tables and figures
LINEUP: MappingProxyType[str, Entrant] = MappingProxyType(
    {
        "icp": Entrant("ICP, point to point, from the identity, as in Sect. 4.2", False, "tab:red", "x"),
        "icp-plane": Entrant("ICP, point to plane, from the identity", False, "tab:brown", "+", False),
        "planes": Entrant("planes and their consensus, as in Sect. 4.3", False, "tab:orange", "s"),
        "fpfh-ransac": Entrant("features (FPFH) and RANSAC, then ICP", False, "tab:pink", "v", False),
        "kiss": Entrant("KISS-Matcher, then ICP", False, "tab:olive", "^", False),
        "hemisphere": Entrant("the paper's spectral chain, as in Sect. 4.4", True, "tab:green", "o"),
        "spectral": Entrant("spectral, this project's default", True, "tab:blue", "D"),
    }
)


def label(method: str, edge: int) -> str:
    """A method and its grid as people read it: "icp", "spectral 128³"."""
    return f"{method} {edge}³" if edge else method


def runs(methods: Iterable[str], edges: Iterable[int]) -> tuple[tuple[str, int], ...]:
    """Method and voxels per edge of every run, in the lineup's order; 0 for a method without a grid."""
    chosen, grids = set(methods), tuple(edges)
    return tuple(
        (name, edge)
        for name, entrant in LINEUP.items()
        if name in chosen
        for edge in (grids if entrant.on_grids else (0,))
    )
