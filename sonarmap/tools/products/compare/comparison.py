# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Two surveys compared: the new one brought onto the old one, distances, and the regions that changed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.locate.locator import Locator
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.surveyed import surveyed_map
from sonarmap.tools.products.compare.alignment import Alignment, agreed, located_views
from sonarmap.tools.products.compare.distances import Distances, Verdict, distances_between
from sonarmap.tools.products.compare.epoch import Epoch
from sonarmap.tools.products.compare.regions import Region, regions_of

REACH, BOUND = 4.0, 2.0  # [voxels], the defaults
_ARM = 100.0  # [m], of the axes by which a frame on the Earth is brought to another
_SURE = np.diag(np.repeat([1e-9, 1e-6], 3) ** 2)  # [rad, m]

Step = Callable[[int, int, str], None]


def _silent(done: int, total: int, text: str) -> None: ...


class NotAlignedError(InputError):
    """The new map could not be brought onto the old one."""


@dataclass(frozen=True, slots=True)
class CompareSettings:
    """How distances are sought and judged."""

    reach: float | None = None  # how far along the normal the new surface is sought [m]; None for REACH voxels
    bound: float | None = None  # largest level of detection of a place called unchanged [m]; None for BOUND voxels


@dataclass(frozen=True)  # without slots: what is counted is kept
class Comparison:
    """What changed from an old survey to a new one.

    Attributes:
        old, new: what was compared.
        alignment: how the new map was brought onto the old one; None where frames were kept.
        distances: of all core points, frame of the old map.
        regions: that changed, the largest volume first.
    """

    old: str
    new: str
    alignment: Alignment | None
    distances: Distances
    regions: tuple[Region, ...]

    @cached_property
    def areas(self) -> Mapping[str, float]:
        """What can be said, by the names of `Verdict` in small letters -> area [m^2]."""
        verdict, area = self.distances.verdict, self.distances.cores.area
        return {each.name.lower(): float(area[verdict == each].sum()) for each in Verdict}

    @property
    def median_level(self) -> float:
        """The level of detection, median of what was compared [m]; NaN where nothing was."""
        level = self.distances.level[self.distances.compared]
        return float(np.median(level)) if len(level) else float("nan")

    def __str__(self) -> str:
        gained = sum(region.volume for region in self.regions if region.gained)
        lost = sum(-region.volume for region in self.regions if not region.gained)
        count = len(self.regions)
        areas = self.areas
        changed, alone = areas["gained"] + areas["lost"], areas["old_only"] + areas["new_only"]
        return (
            f"{count} region{'' if count == 1 else 's'} changed from {self.old} to {self.new}: "
            f"gained {gained:,.1f} m3, lost {lost:,.1f} m3\n"
            f"  unchanged {areas['unchanged']:,.0f} m2, beyond the level {changed:,.0f} m2, cannot be said "
            f"{areas['unsure']:,.0f} m2, seen in one survey only {alone:,.0f} m2\n"
            f"  level of detection {self.median_level:.2f} m (median)"
        )

    @property
    def as_json(self) -> Mapping[str, Any]:
        """With units in the names."""
        how = None
        if self.alignment is not None:
            how = {
                "T_old_new": self.alignment.T_old_new.as_matrix().tolist(),
                "covariance": self.alignment.covariance.tolist(),
                "views": self.alignment.tried,
                "located": self.alignment.located,
                "agreeing": self.alignment.agreeing,
            }
        return {
            "old": self.old,
            "new": self.new,
            "alignment": how,
            "voxel_m": self.distances.voxel,
            "core_points": len(self.distances.verdict),
            "level_of_detection_m": None if np.isnan(self.median_level) else self.median_level,
            "sigmas_widened": self.distances.widened,
            "areas_m2": dict(self.areas),
            "regions": [{"number": k, **region.as_json} for k, region in enumerate(self.regions, 1)],
        }


def compare_maps(
    old: Map,
    new: Map,
    registrar: SpectralRegistrar | None,
    settings: CompareSettings,
    step: Step = _silent,
) -> Comparison:
    """The largest parts of two finished maps. Without a registrar both frames on the Earth are kept.

    Raises:
        NotAlignedError: too few views of the new map were located in the old one, or they contradict one another.
        InputError: a map cannot be used, or one has no place on the Earth though frames are kept.
    """
    if registrar is None:
        alignment, placed = None, (_by_earth(old, new), _SURE)
    else:
        alignment = align(old, new, registrar, step)
        placed = alignment.T_old_new, alignment.covariance
    voxel = max(old.voxel, new.voxel)
    names = str(old.path), str(new.path)
    return _compared(
        names, alignment, Epoch.of_map(old), Epoch.of_map(new).moved(placed[0]), placed[1], voxel, settings
    )


def compare_surveys(folder: Map, first: int, second: int, settings: CompareSettings) -> Comparison:
    """Two surveys of one map, in its frame. Raises InputError: its files are missing or damaged."""
    epochs = Epoch.of_map(folder, first), Epoch.of_map(folder, second)
    names = f"survey {first}", f"survey {second}"
    return _compared(names, None, *epochs, None, folder.voxel, settings)


def align(old: Map, new: Map, registrar: SpectralRegistrar, step: Step) -> Alignment:
    """How a new map lies in an old one. Raises NotAlignedError."""
    answers, tried = located_views(Locator(registrar, surveyed_map(old)), surveyed_map(new), step)
    alignment = agreed(answers, tried)
    if alignment is None:
        raise NotAlignedError(
            f"{new.path} cannot be brought onto {old.path}: of {tried} views {len(answers)} were located in it, and "
            "too few of them agree. Are they of one place? Where both lie on the Earth, --keep-frames does without"
        )
    return alignment


def _compared(
    names: tuple[str, str],
    alignment: Alignment | None,
    old: Epoch,
    new: Epoch,
    covariance: np.ndarray | None,
    voxel: float,
    settings: CompareSettings,
) -> Comparison:
    reach, bound = settings.reach or REACH * voxel, settings.bound or BOUND * voxel
    distances = distances_between(old, new, covariance, voxel, reach, bound)
    return Comparison(*names, alignment, distances, tuple(regions_of(distances)))


def _by_earth(old: Map, new: Map) -> RigidTransform:
    """T_old_new by the places of both frames on the Earth. Raises InputError: one is not known."""
    for folder in (old, new):
        if folder.georeference is None or not folder.on_earth(folder.parts[0]):
            raise InputError(
                f"--keep-frames needs two maps placed on the Earth, and the place of {folder.path} is not known; leave "
                "it out, and the maps are brought together by registration"
            )
    assert old.georeference is not None
    assert new.georeference is not None
    if old.georeference.vertical != new.georeference.vertical:
        raise InputError(
            f"heights of {old.path} count from {old.georeference.vertical!r}, those of {new.path} from "
            f"{new.georeference.vertical!r}; leave --keep-frames out, or map one again with --vertical"
        )
    middle = new.parts[0].points.mean(axis=0)
    arms = middle + _ARM * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    places = old.georeference.local(new.georeference.geodetic(arms))
    R = Rotation.align_vectors(places - places.mean(axis=0), arms - arms.mean(axis=0))[0]
    return RigidTransform.from_components(places.mean(axis=0) - R.apply(middle), R)
