"""A ship's underside over a rough bed: bar keel, bilge keels, propeller, rudder, sea chests, bow thruster."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import boulders, debris, relief, scene_of, tilted
from sonarmap.tools.lab.simulate.scenes.harbor import hull
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, ellipsoid, loft, rod

BLADES = 4


@dataclass(frozen=True, slots=True)
class ShipLayout:
    """Pose and size of a ship; in her frame, x is to the bow, y to port, and z = 0 is the water."""

    middle: tuple[float, float]  # x and y of her middle [m]
    heading: float  # of the bow, counterclockwise from x [rad]
    length: float  # [m]
    beam: float  # [m]
    draft: float  # [m]
    bed: float  # mean height of the bed [m]

    def place(self, mesh: Mesh) -> Mesh:
        """A mesh in the ship's frame, moved to the scene's frame."""
        return mesh.moved(Rotation.from_euler("z", self.heading), (*self.middle, 0.0))


def ship_layout(seed: int) -> ShipLayout:
    """The ship of `seed`: 78 to 100 m long, within 8 m of the middle, on any heading."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 21]))
    length = rng.uniform(78.0, 100.0)
    return ShipLayout(
        middle=(rng.uniform(-8, 8), rng.uniform(-8, 8)),
        heading=rng.uniform(-np.pi, np.pi),
        length=length,
        beam=length * rng.uniform(0.15, 0.18),
        draft=length * rng.uniform(0.072, 0.088),
        bed=rng.uniform(-27.0, -24.0),
    )


def ship(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side, the water's surface at z = 0, its bed at -24 to -27 m."""
    layout = ship_layout(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 22]))
    height = tilted(layout.bed, 0.012, rng) + 0.7 * relief(rng)
    loose = boulders(height, 90, rng) + debris(height, 40, rng)
    fittings = [*_keels(layout), *_stern_gear(layout, rng), *_openings(layout, rng)]
    skin = hull(layout.middle, layout.heading, layout.length, layout.beam, layout.draft)
    return scene_of(height, skin, [layout.place(fitting) for fitting in fittings], loose)


def _keels(ship: ShipLayout) -> list[Mesh]:
    """A bar under the flat part of the bottom, and a bilge keel at either turn of the bilge."""
    parts = [box((0.05 * ship.length, 0, -ship.draft), (0.66 * ship.length, 0.5, 0.7))]
    for side in (-1, 1):
        # where harbor.hull's section, a superellipse, turns from the bottom to the side
        turn = Rotation.from_euler("x", side * np.pi / 4)
        middle = 0.01 * ship.length, side * 0.43 * ship.beam, -0.84 * ship.draft
        parts.append(box(middle, (0.38 * ship.length, 0.25, 1.6), turn))
    return parts


def _stern_gear(ship: ShipLayout, rng: np.random.Generator) -> list[Mesh]:
    """The shaft in its boss, and the propeller before harbor.hull's rudder."""
    reach = 0.2 * ship.draft
    # ahead of the rudder's leading edge, below where the bottom rises to the stern
    hub = np.array((-0.49 * ship.length + 3.2, 0.0, -0.72 * ship.draft))
    parts = [
        rod(hub, np.array((0.7, 0, 0)), 0.22 * reach, sides=12),
        cylinder(hub, hub + np.array((0.18 * ship.length, 0, 0)), 0.3, sides=12),
        box(hub + np.array((0.05 * ship.length, 0, 0.16 * ship.draft)), (0.5, 0.3, 0.32 * ship.draft)),
    ]
    first = rng.uniform(0, 2 * np.pi)
    for blade in range(BLADES):
        spin = Rotation.from_euler("x", first + 2 * np.pi * blade / BLADES)
        parts.append(_blade(reach).moved(spin, hub))
    return parts


def _blade(reach: float) -> Mesh:
    """A propeller's blade along z, twisted from steep at its root to flat at its tip, frame of the hub."""
    sections = []
    for share, chord, twist in ((0.12, 0.3, 1.0), (0.5, 0.62, 0.6), (0.8, 0.6, 0.42), (1.0, 0.2, 0.35)):
        flat = 0.5 * np.array([[-0.06, -chord], [0.06, -chord], [0.06, chord], [-0.06, chord]]) * reach
        ring = np.column_stack([flat, np.full(4, share * reach)])
        sections.append(Rotation.from_euler("z", twist).apply(ring))
    return loft(sections)


def _openings(ship: ShipLayout, rng: np.random.Generator) -> list[Mesh]:
    """Sea chests' gratings, a bow thruster's rims, a bulb at the bow, a sounder's dome beside the keel."""
    bottom, bulb = -ship.draft, (0.045 * ship.length, 0.09 * ship.beam, 0.26 * ship.draft)
    parts = [
        ellipsoid((0.478 * ship.length, 0, 0.66 * bottom), bulb),
        ellipsoid((0.3 * ship.length, rng.uniform(0.06, 0.12) * ship.beam, bottom), (1.0, 0.6, 0.6)),
    ]
    for along, across in ((-0.2, 1), (-0.12, -1), (0.12, 1)):
        spot = ((along + rng.uniform(-0.03, 0.03)) * ship.length, across * rng.uniform(0.12, 0.26) * ship.beam)
        parts.append(box((*spot, bottom), rng.uniform((1.6, 1.2, 0.7), (2.6, 1.8, 0.9))))
    rim = np.array((0.4 * ship.length, 0.0, 0.62 * bottom))
    half = 0.5 * ship.beam * (1 - 0.8**5) * 0.8 + 0.15
    parts.append(rod(rim, np.array((0, half, 0)), 0.16 * ship.draft))
    return parts
