"""The methods that map the flood gate: the paper's three, this project's, and more recent ones."""

from collections.abc import Iterable
from dataclasses import dataclass
from types import MappingProxyType

EXTENT = 256.0  # of the paper's grids [m]
VOXEL = 2.0  # of methods without a grid of their own [m]


@dataclass(frozen=True, slots=True)
class FloodgateMethod:
    """A method of the comparison."""

    title: str  # what it does, in words
    on_grids: bool  # whether it runs once on each of the paper's grids
    color: str  # in the figures
    mark: str  # in the figures
    in_figures: bool = True  # whether the maps and motions are drawn; those of the paper's methods and this project's


TRUTH = "true poses"

# Name, as `build` of tools/methods/registry.py knows it -> method, in the order of tables and figures
COMPARED: MappingProxyType[str, FloodgateMethod] = MappingProxyType(
    {
        "icp": FloodgateMethod("ICP, point to point, started at the identity, as in Sect. 4.2", False, "tab:red", "x"),
        "icp-plane": FloodgateMethod("ICP, point to plane, started at the identity", False, "tab:brown", "+", False),
        "planes": FloodgateMethod("registration of planes by consensus, as in Sect. 4.3", False, "tab:orange", "s"),
        "fpfh-ransac": FloodgateMethod("FPFH features and RANSAC, then ICP", False, "tab:pink", "v", False),
        "kiss": FloodgateMethod("KISS-Matcher, then ICP", False, "tab:olive", "^", False),
        "hemisphere": FloodgateMethod("the paper's spectral chain, as in Sect. 4.4", True, "tab:green", "o"),
        "spectral": FloodgateMethod("this project's default method", True, "tab:blue", "D"),
    }
)


def label(method: str, edge: int) -> str:
    """A method and its grid as people read it: "icp", "spectral 128³"."""
    return f"{method} {edge}³" if edge else method


def runs(methods: Iterable[str], edges: Iterable[int]) -> tuple[tuple[str, int], ...]:
    """Method and voxels per edge of every run, in the order of COMPARED; 0 for a method without a grid."""
    chosen, grids = set(methods), tuple(edges)
    return tuple(
        (name, edge)
        for name, method in COMPARED.items()
        if name in chosen
        for edge in (grids if method.on_grids else (0,))
    )
