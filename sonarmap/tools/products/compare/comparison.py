"""Comparison of two surveys: alignment of the new one with the old one, distances, and changed regions.

For the alignment, views of the new map are located in the old one; those that agree on one transform count.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.locate.locator import Locator
from sonarmap.slam.locate.place import BOUND as MAX_APART
from sonarmap.slam.locate.surveyed_map import SurveyedMap
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map, surveyed_map
from sonarmap.tools.products.compare.cloud import PointCloud
from sonarmap.tools.products.compare.detection import Distances, Region, Verdict, distances_between, regions_of
from sonarmap.tools.products.compare.surface import Epoch

MOST_VIEWS = 16  # largest number of views of the new map, spread over its track
FEWEST = 2  # least number of views that have to agree, unless the map has a single one
_ROUNDS = 5  # of the iteration to the mean transform
REACH, BOUND = 4.0, 2.0  # defaults of `CompareSettings` [voxels]
_SIZES = " Is the cloud in meters? It extends over {:,.0f} m, the map over {:,.0f} m."
_ARM = 100.0  # length of the axes by which one frame on the Earth is aligned with another [m]
_EXACT = np.diag(np.repeat([1e-9, 1e-6], 3) ** 2)  # covariance of the alignment of maps in one frame [rad, m]
Step = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Alignment:
    T_old_new: RigidTransform  # p_old = T_old_new p_new [m]
    covariance: np.ndarray  # (6, 6) rotation first [rad, m], left tangent: T_true = Exp(xi) T_old_new
    located: int  # number of views of the new map that were located in the old one
    agreeing: int  # number of located views that agree with the transform
    tried: int  # number of views

    @property
    def inverse(self) -> "Alignment":
        """The inverse alignment, with the same numbers of views."""
        T = self.T_old_new.inv()
        return replace(self, T_old_new=T, covariance=propagated(T, self.covariance))


def located_views(
    locator: Locator, new: SurveyedMap, step: Callable[[int, int, str], None]
) -> tuple[list[tuple[RigidTransform, np.ndarray]], int]:
    """T_old_new from each view of the new map that was located in the old one, with its covariance (6, 6) [rad, m] in
    the left tangent; and the number of views tried."""
    apart = new.apart
    keys = [apart[k] for k in np.unique(np.linspace(0, len(apart) - 1, MOST_VIEWS).round().astype(int)).tolist()]
    answers: list[tuple[RigidTransform, np.ndarray]] = []
    for done, key in enumerate(keys):
        step(done, len(keys), f"view {key}")
        T_new_view = new.T_map_sensor[key]
        found = locator.locate(Scan(new.seen_from(T_new_view, new.view_of(key)), name=f"view {key}"))
        if found.located:
            in_body = found.covariance + new.covariances[key]
            answers.append((found.T_map_scan * T_new_view.inv(), propagated(found.T_map_scan, in_body)))
    step(len(keys), len(keys), "")
    return answers, len(keys)


def agreed(answers: list[tuple[RigidTransform, np.ndarray]], tried: int) -> Alignment | None:
    """The transform on which most answers agree; None if too few do. Its covariance is that of a single answer: errors
    of the maps' poses, which the answers partly share, do not average out."""
    if not answers:
        return None
    T = RigidTransform.concatenate([each for each, _ in answers])
    C = np.array([each for _, each in answers])
    counts = [int((_apart(T[k], C[k], T, C) <= MAX_APART).sum()) for k in range(len(answers))]
    best = int(np.argmax(counts))
    inside = _apart(T[best], C[best], T, C) <= MAX_APART
    if inside.sum() < min(FEWEST, tried) or 2 * inside.sum() <= len(answers):
        return None
    mean: RigidTransform = T[best]
    information = np.linalg.inv(C[inside])
    total = information.sum(axis=0)
    for _ in range(_ROUNDS):
        xi = (T[inside] * mean.inv()).as_exp_coords()
        mean = RigidTransform.from_exp_coords(np.linalg.solve(total, np.einsum("nab,nb->a", information, xi))) * mean
    return Alignment(mean, len(information) * np.linalg.inv(total), len(answers), int(inside.sum()), tried)


def _apart(T: RigidTransform, C: np.ndarray, others: RigidTransform, covariances: np.ndarray) -> np.ndarray:
    """(n,) distances of the transforms `others` from T [sigmas]."""
    return lengths((others * T.inv()).as_exp_coords(), covariances + C)


def _silent(done: int, total: int, text: str) -> None: ...


class NotAlignedError(InputError):
    """The new map could not be aligned with the old one."""


@dataclass(frozen=True, slots=True)
class CompareSettings:
    reach: float | None = None  # range along the normal in which the new surface is sought [m]; None for REACH voxels
    bound: float | None = None  # largest level of detection of an unchanged core point [m]; None for BOUND voxels


@dataclass(frozen=True)  # without slots, for cached properties
class Comparison:
    """Changes from an old survey to a new one.

    Attributes:
        old, new: names of the surveys.
        alignment: of the new map with the old one; None if the frames were kept.
        distances: of all core points, in the frame of the old map.
        regions: changed regions, the largest volume first.
        notes: remarks about a cloud, one sentence each.
    """

    old: str
    new: str
    alignment: Alignment | None
    distances: Distances
    regions: tuple[Region, ...]
    notes: tuple[str, ...] = ()

    @cached_property
    def areas(self) -> Mapping[str, float]:
        """Area of each verdict [m^2], by its name in lower case."""
        verdict, area = self.distances.verdict, self.distances.cores.area
        return {kind.name.lower(): float(area[verdict == kind].sum()) for kind in Verdict}

    @property
    def median_level(self) -> float:
        """Median level of detection of the compared core points [m]; NaN without any."""
        level = self.distances.level[self.distances.compared]
        return float(np.median(level)) if len(level) else float("nan")

    def __str__(self) -> str:
        gained = sum(region.volume for region in self.regions if region.gained)
        lost = sum(-region.volume for region in self.regions if not region.gained)
        count = len(self.regions)
        areas = self.areas
        level = f"{self.median_level:.2f} m (median)" if len(self.distances.compared) else "unknown: nothing in common"
        changed, alone = areas["gained"] + areas["lost"], areas["old_only"] + areas["new_only"]
        return (
            f"{count} region{'' if count == 1 else 's'} changed from {self.old} to {self.new}: "
            f"gained {gained:,.1f} m3, lost {lost:,.1f} m3\n"
            f"  unchanged {areas['unchanged']:,.0f} m2, beyond the level {changed:,.0f} m2, unsure "
            f"{areas['unsure']:,.0f} m2, seen in one survey only {alone:,.0f} m2\n"
            f"  level of detection {level}"
        )

    @property
    def as_json(self) -> Mapping[str, Any]:
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
            "volume_sigmas_widened": self.distances.together,
            "areas_m2": dict(self.areas),
            "notes": list(self.notes),
            "regions": [{"number": k, **region.as_json} for k, region in enumerate(self.regions, 1)],
        }


def compare_maps(
    old: Map | PointCloud,
    new: Map | PointCloud,
    registrar: SpectralRegistrar | None,
    settings: CompareSettings,
    step: Step = _silent,
) -> Comparison:
    """Compare the largest parts of two finished maps, or of a map and a cloud. Without a registrar they are in one
    frame, by their georeferences if both have one, else as they are.

    Raises:
        NotAlignedError: too few views of the new map were located in the old one, or they contradict one another.
        InputError: a map cannot be used, or heights of maps on the Earth count from different levels.
    """
    if registrar is None:
        alignment, placed = None, (_in_one_frame(old, new), _EXACT)
    else:
        alignment = align(old, new, registrar, step)
        placed = alignment.T_old_new, alignment.covariance
    if isinstance(new, PointCloud):
        assert isinstance(old, Map), "as two clouds are refused before"
        before = Epoch.of_map(old)
        after = Epoch.of_cloud(placed[0].apply(new.points), new.weight, new.sigma, before)
    else:
        after = Epoch.of_map(new).moved(placed[0])
        is_map = isinstance(old, Map)
        before = Epoch.of_map(old) if is_map else Epoch.of_cloud(old.points, old.weight, old.sigma, after)
    names, voxel = (str(old.path), str(new.path)), max(old.voxel, new.voxel)
    notes = [note for each in (old, new) if isinstance(each, PointCloud) for note in each.notes]
    compared = _compared(names, alignment, before, after, placed[1], voxel, settings)
    return replace(compared, notes=tuple(notes))


def compare_surveys(folder: Map, first: int, second: int, settings: CompareSettings) -> Comparison:
    """Compare two surveys of one map, in its frame."""
    epochs = Epoch.of_map(folder, first), Epoch.of_map(folder, second)
    names = f"survey {first}", f"survey {second}"
    return _compared(names, None, *epochs, None, folder.voxel, settings)


def align(old: Map | PointCloud, new: Map | PointCloud, registrar: SpectralRegistrar, step: Step) -> Alignment:
    """Align a new survey with an old one; as a cloud has no views, those of the map are located in it. Raises
    NotAlignedError."""
    target, source = (new, old) if isinstance(new, PointCloud) else (old, new)
    assert isinstance(source, Map)
    views = surveyed_map(source)
    surveyed = surveyed_map(target) if isinstance(target, Map) else target.seen_as(views)
    answers, tried = located_views(Locator(registrar, surveyed), views, step)
    alignment = agreed(answers, tried)
    if alignment is None:
        sizes = "" if isinstance(target, Map) else _SIZES.format(*target.extents(source))
        raise NotAlignedError(
            f"{source.path} cannot be aligned with {target.path}: {len(answers)} of {tried} views were located in it, "
            f"and too few of them agree. Do both show one place?{sizes} If both are in one frame, give --same-frame"
        )
    return alignment if source is new else alignment.inverse


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


def _on_earth(each: Map | PointCloud) -> Georeference | None:
    """Georeference of the frame; None if it is not known."""
    return each.georeference if isinstance(each, PointCloud) or each.on_earth(each.parts[0]) else None


def _in_one_frame(old: Map | PointCloud, new: Map | PointCloud) -> RigidTransform:
    """T_old_new from the georeferences; the identity without them."""
    before, after = _on_earth(old), _on_earth(new)
    if before is None or after is None:
        return RigidTransform.identity()
    if before.vertical != after.vertical:
        raise InputError(
            f"heights of {old.path} count from {before.vertical!r}, those of {new.path} from "
            f"{after.vertical!r}; leave --same-frame out, or map one again with --vertical, or lines with --heights"
        )
    middle = (new.parts[0] if isinstance(new, Map) else new).points.mean(axis=0)
    arms = middle + _ARM * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    places = before.local(after.geodetic(arms))
    R = Rotation.align_vectors(places - places.mean(axis=0), arms - arms.mean(axis=0))[0]
    return RigidTransform.from_components(places.mean(axis=0) - R.apply(middle), R)
