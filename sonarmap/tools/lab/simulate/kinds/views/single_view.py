"""Pairs of single views of a 3D sonar whose measurement is distorted, as the kinds beside this file say how."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.kinds.reliefs import relief_of
from sonarmap.tools.lab.simulate.kinds.views.draws import noise_of, observer_of, pair_draws
from sonarmap.tools.lab.simulate.kinds.views.encounter import draw_views
from sonarmap.tools.lab.simulate.pairs.viewpoints import Observer, View
from sonarmap.tools.lab.simulate.sensing.ghosts import reflect
from sonarmap.tools.lab.simulate.sensing.noise import Noise, measure
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS, mutual_overlap
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes

# The ranges that a sonar reports for true ones [m], inf without an echo
Distortion = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True)
class Shot:
    """A view that is to be measured.

    Attributes:
        observer: the scene and the sensor.
        view: the true one.
        noise: besides the distortion.
        distortion: draws how the measurement is distorted.
        rng: draws the noise.
        name: "target" or "source".
    """

    observer: Observer
    view: View
    noise: Noise
    distortion: np.random.Generator
    rng: np.random.Generator
    name: str

    @property
    def stamp(self) -> float:
        """The source's is a second later."""
        return float(self.name == "source")


def single_view_pair(
    kind: str, number: int, seed: int, scene: str, overlaps: tuple[float, float], measured: Callable[[Shot], Scan]
) -> KindPair:
    """Pair `number` of the set `seed`: two views from anywhere, measured as the kind does.

    The scan's frame is the sensor's and its origin the viewpoint.

    Raises:
        InputError: the scene has no such pair.
    """
    draws, noise = pair_draws(kind, number, seed), noise_of(kind, number, scene)
    observer = observer_of(scene, draws.scene)
    target, source = draw_views((observer, observer), overlaps, draws.poses)
    T_target_source = target.T_world_sensor.inv() * source.T_world_sensor
    shared = mutual_overlap(target.points, source.points, T_target_source, OVERLAP_RADIUS * observer.world.kind.scale)
    return KindPair(
        kind,
        number,
        seed,
        scene,
        relief_of(scene),
        measured(Shot(observer, target, noise, draws.distortion, draws.target, "target")),
        measured(Shot(observer, source, noise, draws.distortion, draws.source, "source")),
        target.T_world_sensor,
        source.T_world_sensor,
        shared,
    )


def distorted_scan(shot: Shot, distort: Distortion) -> Scan:
    """The scan of a still sonar that reports other ranges than the true ones, its ghosts' included."""
    sensor, view = shot.observer.sensor, shot.view
    ghosts = None
    if shot.noise.ghosts > 0:
        ghosts = _reported(reflect(shot.observer.world, sensor, view.T_world_sensor), distort)
    echoes = _reported(view.echoes, distort)
    return measure(echoes, sensor, shot.noise, shot.rng, ghosts=ghosts, stamp=shot.stamp, name=shot.name)


def _reported(echoes: Echoes, distort: Distortion) -> Echoes:
    return Echoes(distort(echoes.ranges), echoes.strengths)
