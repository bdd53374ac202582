"""Parts of the vehicle in view: noticed if the rest changes, and never claimed of a bed or a wall."""

from collections.abc import Callable

import numpy as np
import pytest

from sonarmap.slam.odd.standing import StandingParts, in_words
from sonarmap.spectral.scan import Scan

AZIMUTHS, TILTS = np.meshgrid(np.radians(np.linspace(-45, 45, 60)), np.radians(np.linspace(-70, -5, 40)))
BEAMS = np.column_stack(
    [each.ravel() for each in (np.cos(TILTS) * np.cos(AZIMUTHS), np.cos(TILTS) * np.sin(AZIMUTHS), np.sin(TILTS))]
)
Ranges = Callable[[int, np.random.Generator], np.ndarray]


def bed(altitude: float, relief: float, tilt: float = 0.0) -> Ranges:
    """A bed below a vehicle at constant altitude [m], which rolls by `tilt` [rad], with a relief that passes below."""

    def ranges(k: int, rng: np.random.Generator) -> np.ndarray:
        roll = tilt * rng.normal()
        down = -BEAMS[:, 2] * np.cos(roll) + BEAMS[:, 1] * np.sin(roll)
        flat = altitude / np.maximum(down, 0.05)
        return flat * (1 + relief * np.sin(3 * AZIMUTHS.ravel() + 7 * TILTS.ravel() + 2.1 * k))

    return ranges


def wall(distance: float) -> Ranges:
    """A wall ahead, followed at a constant distance [m], over a bed 3 m below with a relief."""
    return lambda k, rng: np.minimum(distance / BEAMS[:, 0], bed(3.0, 0.2)(k, rng))


def pipe(above: float) -> Ranges:
    """A pipe below the vehicle, along its way, `above` [m] a bed 2 m below."""

    def ranges(k: int, rng: np.random.Generator) -> np.ndarray:
        on_it = np.abs(BEAMS[:, 1] / BEAMS[:, 2]) < 0.1
        return np.where(on_it, (2.0 - above) / -BEAMS[:, 2], bed(2.0, 0.1)(k, rng))

    return ranges


def rails(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points on two rails, 0.8 to 1.1 m ahead."""
    along = rng.uniform(0.8, 1.1, count)
    return np.column_stack([along, rng.choice([-0.3, 0.3], count), np.full(count, -0.2)]) + rng.normal(
        0, 0.01, (count, 3)
    )


def found(ranges: Ranges, count: int = 20, share: float = 0.0, viewpoint: np.ndarray | None = None) -> StandingParts:
    """`count` scans with 1 % of range noise, and this share of points on the vehicle's rails."""
    parts, rng = StandingParts(), np.random.default_rng(4)
    for k in range(count):
        far = ranges(k, rng) * rng.normal(1, 0.01, len(BEAMS))
        points = (far[:, None] * BEAMS)[far < 30]
        points = np.vstack([points, rails(round(share / (1 - share) * len(points)), rng)])
        seen_from = None if viewpoint is None else np.tile(viewpoint, (len(points), 1)).astype(np.float32)
        points += 0 if viewpoint is None else viewpoint
        parts.add(Scan(points.astype(np.float32), viewpoints=seen_from))
    return parts


SCENES = {
    "a rough bed": bed(4.0, 0.2),
    "a flat bed under a rolling vehicle": bed(4.0, 0.0, tilt=0.2),
}
CLEAN = SCENES | {
    "a flat bed under a level vehicle": bed(3.0, 0.0),
    "a flat bed near by": bed(1.2, 0.0),
    "a rough bed near by": bed(1.2, 0.1),
    "a wall that is followed": wall(4.0),
    "a wall near by": wall(1.5),
    "a pipe on the bed": pipe(0.3),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("share", [0.3, 0.05])
@pytest.mark.parametrize("viewpoint", [None, np.array([0.5, 0.0, -1.0])])
def test_rails_are_noticed_with_boxes_that_hold_them(scene: str, share: float, viewpoint: np.ndarray | None) -> None:
    parts = found(SCENES[scene], share=share, viewpoint=viewpoint).found()
    assert len(parts) == 2
    assert sum(part.share for part in parts) == pytest.approx(share, rel=0.2)
    points = rails(5000, np.random.default_rng(1)) + (0 if viewpoint is None else viewpoint)
    inside = [((points >= part.box[:3]) & (points <= part.box[3:])).all(axis=1) for part in parts]
    assert np.any(inside, axis=0).mean() > 0.99
    assert all((np.subtract(part.box[3:], part.box[:3]) < [0.6, 0.4, 0.4]).all() for part in parts)
    assert in_words(parts).startswith("2 objects from 0.")
    assert in_words(parts).count("--exclude-box ") == 2


@pytest.mark.parametrize("scene", CLEAN)
def test_nothing_is_claimed_without_a_part_of_the_vehicle(scene: str) -> None:
    assert found(CLEAN[scene]).found() == []


def test_nothing_is_claimed_of_few_scans_or_where_all_stands_still() -> None:
    assert found(SCENES["a rough bed"], count=7, share=0.3).found() == []
    assert found(bed(3.0, 0.0), share=0.3).found() == []  # the vehicle may stand before a pile


def test_long_surveys_are_thinned() -> None:
    parts = found(SCENES["a rough bed"], count=600, share=0.3)
    assert (parts.added, parts.step, len(parts.near)) == (600, 8, 75)
    assert len(parts.found()) == 2
