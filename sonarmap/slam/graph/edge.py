"""Edges of a pose graph, and what follows from them: components and spanning trees."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from scipy.cluster.hierarchy import DisjointSet
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration

Kind = Literal["sequential", "odometry", "tie", "loop", "prior"]
ROUNDED = 1e-9  # rounding errors of a covariance or information, as a share of its largest element


@dataclass(frozen=True, slots=True)
class Edge:
    """A measurement between pose i (target) and pose j (source).

    Attributes:
        i, j: indices of the poses; equal for a prior, and only there.
        registration: `T_target_source` is T_i_j; for a prior it is T_world_i. The covariance is (6, 6),
            rotation first [rad, m], body tangent of j.
        kind: "sequential" (registered consecutive scans), "loop" (any other registered pair), "odometry" (dead
            reckoning), "tie" (measured by a person) or "prior" (a pose in the world).
        by_hand: whether a person vouches for it; it is then neither rejected nor down-weighted.
    """

    i: int
    j: int
    registration: Registration
    kind: Kind
    by_hand: bool = False

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError(f"{self.name} is of kind '{self.kind}'; wanted one of {', '.join(get_args(Kind))}")
        if min(self.i, self.j) < 0 or (self.i == self.j) != (self.kind == "prior"):
            raise InputError(
                f"{self.name}, {self.kind}: wanted two different poses, counted from 0; "
                "a prior, and only it, names one pose twice"
            )
        if not self.registration.T_target_source.single:
            raise InputError(f"{self.name} holds a stack of transforms; give every edge a single one")
        check_definite(self.registration.covariance, f"the covariance of {self.name}")

    @property
    def is_registered(self) -> bool:
        """Whether it is a registration of two scans."""
        return self.kind in ("sequential", "loop")

    @property
    def is_of_pair(self) -> bool:
        """Whether it stands for a pair of scans: registered, or measured by a person."""
        return self.kind not in ("odometry", "prior")

    def with_scale_factor(self, factor: float) -> "Edge":
        """The edge with its whole covariance multiplied, and that by the scans too."""
        measured, by_scans = self.registration, self.registration.covariance_by_scans
        scaled = replace(
            measured,
            covariance=factor * measured.covariance,
            covariance_by_scans=None if by_scans is None else factor * by_scans,
        )
        return replace(self, registration=scaled)

    def scaled(self, factor: float) -> "Edge":
        """The edge with its covariance multiplied; only the scans' part where instruments or the motion took part."""
        measured, by_scans = self.registration, self.registration.covariance_by_scans
        if measured.T_by_scans is None or by_scans is None:
            return self.with_scale_factor(factor)
        both, alone = np.linalg.inv(measured.covariance), np.linalg.inv(by_scans)
        covariance = np.linalg.inv(alone / factor + (both - alone))
        # relative to the scans' own estimate, the rest keeps its information vector
        xi: np.ndarray = (measured.T_by_scans.inv() * measured.T_target_source).as_exp_coords()
        scaled = replace(
            measured,
            T_target_source=measured.T_by_scans * RigidTransform.from_exp_coords(covariance @ both @ xi),
            covariance=(covariance + covariance.T) / 2,
            covariance_by_scans=factor * by_scans,
        )
        return replace(self, registration=scaled)

    @property
    def name(self) -> str:
        return f"edge {self.i} -> {self.j}"


def check_definite(matrix: np.ndarray, name: str) -> None:
    """Raise InputError unless `matrix` is (6, 6), finite, symmetric and positive definite."""
    if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
        raise InputError(f"{name} has shape {matrix.shape} or is not finite; wanted (6, 6) finite numbers")
    if not (matrix == matrix.T).all() and np.abs(matrix - matrix.T).max() > ROUNDED * np.abs(matrix).max():
        raise InputError(f"{name} is not symmetric; wanted a symmetric positive definite matrix")
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(matrix).min())
        raise InputError(
            f"{name} is not positive definite (smallest eigenvalue {smallest:.3g}, "
            f"largest element {np.abs(matrix).max():.3g}); give every direction a positive variance"
        ) from None


def inverse_definite(matrix: np.ndarray) -> np.ndarray:
    """The inverse of a symmetric positive definite matrix, itself symmetric: information or covariance."""
    # pyrefly: ignore[bad-assignment]
    inverse: np.ndarray = cho_solve(cho_factor(matrix, lower=True), np.eye(len(matrix)))
    return (inverse + inverse.T) / 2


def spanning_tree(count: int, edges: Sequence[Edge]) -> list[Edge]:
    """Spanning forest of `count` poses; takes consecutive scans first, then odometry, ties and loops."""
    joined = DisjointSet(range(count))
    between = [edge for edge in edges if edge.kind != "prior"]
    order = get_args(Kind)
    return [edge for edge in sorted(between, key=lambda e: order.index(e.kind)) if joined.merge(edge.i, edge.j)]


def components(count: int, edges: Sequence[Edge]) -> tuple[tuple[int, ...], ...]:
    """Sets of poses that edges join, each ascending, in the order of their first poses."""
    joined = DisjointSet(range(count))
    for edge in edges:
        joined.merge(edge.i, edge.j)
    return tuple(sorted(tuple(sorted(subset)) for subset in joined.subsets()))
