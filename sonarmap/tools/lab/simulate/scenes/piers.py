"""A bridge's piers in a river that flows along x: shaft, footing and cap, fenders, driftwood caught by them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, cylinder, prism

FOOT = -34.0  # below the lowest bed: where piers and piles end [m]


@dataclass(frozen=True, slots=True)
class Pier:
    """One pier.

    Attributes:
        x, y: of its middle [m].
        length, width: along and across the flow [m].
        footing: how far its footing reaches beyond it on all sides [m].
        footing_top: height of that [m].
        round: whether its ends are round rather than pointed.
        fenced: whether it stands beside the fairway and has fenders.
        turned: its heading against the flow [rad].
    """

    x: float
    y: float
    length: float
    width: float
    footing: float
    footing_top: float
    round: bool
    fenced: bool
    turned: float


def outline(length: float, width: float, is_round: bool) -> np.ndarray:
    """A pier's plan (K, 2), counterclockwise, its ends pointed or half circles."""
    straight, half = length / 2 - width / 2, width / 2
    angle = np.linspace(-np.pi / 2, np.pi / 2, 7 if is_round else 3)[:, None]
    end = np.column_stack([np.cos(angle), np.sin(angle)]) * half
    return np.concatenate([end + np.array((straight, 0)), -end - np.array((straight, 0))])


def _placed(pier: Pier, mesh: Mesh) -> Mesh:
    """A mesh of the pier's frame, x along it, in the scene's."""
    turn = Rotation.from_euler("z", pier.turned)
    return Mesh(turn.apply(mesh.vertices) + np.array((pier.x, pier.y, 0.0)), mesh.triangles)


def shaft(pier: Pier, deck: tuple[float, float], heading: float) -> list[Mesh]:
    """The shaft, its footing with a step, and the cap that carries the deck."""
    underside, width = deck
    reach = 2 * pier.footing
    parts = [
        prism(outline(pier.length, pier.width, pier.round), FOOT, underside - 1.4),
        prism(outline(pier.length + reach, pier.width + reach, False), FOOT, pier.footing_top),
        prism(outline(pier.length + reach / 2, pier.width + reach / 2, False), FOOT, pier.footing_top + 1.1),
    ]
    turn = Rotation.from_euler("z", heading - pier.turned)
    cap = box((0, 0, underside - 0.8), (1.2 * pier.width, width, 1.6), turn)
    return [_placed(pier, part) for part in [*parts, cap]]


def fenders(pier: Pier, rng: np.random.Generator) -> list[Mesh]:
    """Rows of piles with a waling along both sides, a dolphin before either end, one of them out of line."""
    aside, parts = pier.width / 2 + pier.footing + 1.0, []
    for side in (-1, 1):
        for along in np.arange(-pier.length / 2, pier.length / 2 + 0.1, rng.uniform(3.0, 4.5)):
            foot = (along, side * (aside + 0.6), FOOT)
            parts.append(cylinder(foot, (along, side * aside, 2.5), 0.35, sides=10))
        parts.append(box((0, side * (aside - 0.3), rng.uniform(-0.8, 0.6)), (pier.length + 1.5, 0.5, 0.7)))
    for end in (-1, 1):
        middle = np.array((end * (pier.length / 2 + rng.uniform(6.0, 11.0)), rng.uniform(-1.5, 1.5), 0.0))
        for turn in 2 * np.pi * (np.arange(rng.integers(3, 6)) + rng.random()) / 5:
            lean = np.array((np.cos(turn), np.sin(turn), 0.0))
            foot, head = (
                middle + spread + np.array((0, 0, z)) for spread, z in ((2.2 * lean, FOOT), (0.6 * lean, 3.5))
            )
            parts.append(cylinder(foot, head, 0.4, sides=10))
    return [_placed(pier, part) for part in parts]


def driftwood(pier: Pier, bed: float, rng: np.random.Generator) -> list[Mesh]:
    """Driftwood that the flow has laid against the pier's upstream end, more or none of it."""
    parts = []
    for _ in range(rng.integers(0, 5)):
        middle = np.array((-pier.length / 2 - rng.uniform(0.5, 3.0), rng.uniform(-3.0, 3.0), 0.0))
        middle[2] = max(pier.footing_top, bed) + rng.uniform(0.3, 3.0)
        reach = Rotation.from_euler("ZYX", rng.uniform((0.8, -0.4, 0), (2.3, 0.4, 0))).apply((rng.uniform(2, 6), 0, 0))
        parts.append(cylinder(middle - reach, middle + reach, rng.uniform(0.2, 0.55), sides=8))
    return [_placed(pier, part) for part in parts]
