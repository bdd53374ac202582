"""Single views of a Water Linked Sonar 3D-15 as it really is: few echoes, in patches, several beams alike.

Measured on six range images of a ship's hull (Water Linked's wlsonar, tests/data/ship_short.sonar, 256 x 64 beams):

- 61 to 67 % of the beams have a range, 28 % in all six images and 11 % in none; whether a beam has one correlates by
  0.66, 0.52, 0.42 and 0.33 with its neighbor 1, 2, 4 and 8 columns on, and by 0.62, 0.47, 0.35 and 0.28 over rows;
  between consecutive images by 0.52.
- 45 % of the neighbors in a row have exactly the same range: main lobes are wider than the beams' spacing, and one
  strong echo is picked by several beams.
- Ranges come in steps of 0.76 mm, nearly all of them in every second. On smooth parts they scatter by 0.5 to 2 cm.
- 0.9 % of the echoes have at most four others within two beams, and 4 % are 1 m or more off the median of those.

So here every beam picks the strongest echo of its lobe, speckle and slow fading included, and reports nothing where
even that is weak. No other dropouts: those are the real ones.
"""

from dataclasses import replace

import numpy as np

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.kinds.views.single_view import Shot, single_view_pair
from sonarmap.tools.lab.simulate.sensing.ghosts import reflect
from sonarmap.tools.lab.simulate.sensing.lobes import fade, pick_strongest
from sonarmap.tools.lab.simulate.sensing.noise import disturb, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes

STEP = 2 * 0.000762939453125  # of a range [m]
LOBE = 1.0  # standard deviation of a beam's main lobe, in beams
LOST = 0.03  # share of single beams that report nothing although they could
WEAKEST = 0.2  # of the strengths that are reported, linear as Echoes.strengths


def sonar3d15_pair(number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
    """A builder of SCAN_KINDS.

    Raises:
        InputError: the scene has no such pair.
    """
    return single_view_pair("sonar3d15", number, seed, scene, overlaps, real_scan)


def real_scan(shot: Shot) -> Scan:
    """What the sonar writes down of a view."""
    sensor, noise = shot.observer.sensor, replace(shot.noise, dropouts=0.0)
    ghosts = None
    if noise.ghosts > 0:
        ghosts = reflect(shot.observer.world, sensor, shot.view.T_world_sensor)
    noisy = disturb(shot.view.echoes, sensor, noise, shot.rng, ghosts)
    picked = pick_strongest(fade(noisy, shot.distortion), LOBE)
    weak = (picked.strengths < WEAKEST) | (shot.rng.random(picked.ranges.shape) < LOST)
    steps = np.rint(picked.ranges / STEP) * STEP
    echoes = Echoes(np.where(weak, np.inf, steps), np.where(weak, 0.0, picked.strengths))
    return scan_of(echoes, sensor, stamp=shot.stamp, name=shot.name)
