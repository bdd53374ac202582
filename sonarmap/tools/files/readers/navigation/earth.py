# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Places on the Earth as meters in the map's frame, and headings by its North."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.geo.georeference import EAST, Georeference
from sonarmap.tools.files.geo.projection import Projection, on_the_earth
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

_ROUNDED = 5  # decimals of the origin's degrees: a meter


def local_places(
    values: np.ndarray, are_degrees: bool, settings: NavigationSettings, notes: list[str]
) -> tuple[np.ndarray, Georeference]:
    """Rows with x East and y North of the map's origin, and where that is. `values`: (n, 6) in the order of COLUMNS,
    with longitude and latitude [deg] (`are_degrees`) or easting and northing [m] in place of x and y. Raises
    InputError: a place that the CRS does not cover, or far from the others."""
    values = values.copy()
    known = np.isfinite(values[:, 3:5]).all(axis=1)
    if are_degrees:
        unset = known & (values[:, 3:5] == 0).all(axis=1)
        if unset.any():
            notes.append(f"{unset.sum()} rows are at 0, 0, as without a fix; they have no place")
        known &= ~unset
    values[~known, 3:5] = np.nan
    if not known.any():
        raise InputError(
            "no row has a place; wanted a latitude and longitude, or an easting and northing, in some rows"
        )
    # what is East and North at the vehicle's depth; where none is known, at the surface
    heights = -np.nan_to_num(values[known, 5])
    geodetic = np.column_stack([values[known, 4], values[known, 3], heights])
    if not are_degrees:
        geodetic = on_the_earth(np.column_stack([values[known, 3:5], heights]), settings.crs, "--nav-crs")
    origin = settings.origin
    if origin is None:
        origin = rounded_origin(geodetic, "fix", notes)
    if origin.heading != EAST:
        raise InputError(
            "--origin-heading has no effect where navigation places the map, whose x is East; leave it out"
        )
    geodetic[:, 2] += origin.height
    values[known, 3:5] = origin.local(geodetic)[:, :2]
    return values, origin


def rounded_origin(geodetic: np.ndarray, what: str, notes: list[str]) -> Georeference:
    """An origin at the first of places (n, 3), which are of `what`, rounded; a note says so."""
    latitude, longitude = (round(float(angle), _ROUNDED) for angle in geodetic[0, :2])
    notes.append(f"the map's origin is the first {what}, rounded: {latitude:.5f}, {longitude:.5f}")
    return Georeference(latitude, longitude)


def grid_of(settings: NavigationSettings, georeference: Georeference | None) -> Projection:
    """The grid that headings are by. Raises InputError: nobody says where on the Earth the headings were measured."""
    if georeference is None:
        raise InputError(
            "--heading-reference grid: the grid's North depends on the place; give --origin, or navigation with places "
            "on the Earth"
        )
    return Projection.of(georeference, settings.crs)


def by_the_maps_north(
    priors: Sequence[PosePrior | None], georeference: Georeference, grid: Projection | None
) -> list[PosePrior | None]:
    """Priors of a vehicle with headings by the North of the map's origin, where they were by that of their own places.
    The place of a prior that has none is taken to be the origin; `grid` is what headings are by, None for true
    North."""
    changed = list(priors)
    headed = [(k, prior) for k, prior in enumerate(priors) if prior is not None and prior.knows_heading]
    if not headed:
        return changed
    places = np.array([prior.T_world_sensor.translation * prior.knows_position for _, prior in headed])
    geodetic = georeference.geodetic(places)
    # true North lies to the right of grid North by the convergence
    turned = np.zeros(len(headed)) if grid is None else grid.convergence(geodetic)
    ahead = georeference.local(geodetic + np.array([1e-4, 0.0, 0.0])) - georeference.local(geodetic)
    turned = turned + np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1]))
    for (k, prior), turn in zip(headed, turned.tolist(), strict=True):
        T = prior.T_world_sensor
        R = Rotation.from_euler("Z", -turn, degrees=True) * T.rotation
        changed[k] = replace(prior, T_world_sensor=RigidTransform.from_components(T.translation, R))
    return changed
