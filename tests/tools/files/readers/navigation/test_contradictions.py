"""Mistakes in navigation, made on purpose, are recognized from simulated registrations; nothing else is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import poses_of, prior_of
from sonarmap.tools.files.readers.navigation.contradictions import Registered, contradiction, pair_costs

SIGMAS = np.array([0.5, 0.5, 3.0, 0.5, 0.5, 0.1])
UNITS = np.array([np.pi / 180] * 3 + [1.0] * 3)
ALL = np.ones(6, bool)
TIGHT = np.diag([0.003] * 3 + [0.03] * 3) ** 2


def path(rng: np.random.Generator, count: int = 14) -> np.ndarray:
    """(n, 6) a dive with turns, waves and changes of depth, 2 m from scan to scan."""
    heading = 40 + np.cumsum(rng.normal(0, 25, count))
    way = np.cumsum(2 * np.column_stack([np.sin(np.radians(heading)), np.cos(np.radians(heading))]), axis=0)
    depth = 20 + np.cumsum(rng.normal(0, 0.8, count))
    return np.column_stack([rng.normal(2, 6, count), rng.normal(-3, 6, count), heading % 360, way + 5, depth])


def drawn(seed: int | list[int]) -> tuple[np.random.Generator, np.ndarray]:
    """What draws, and the path that it drew first."""
    rng = np.random.default_rng(seed)
    return rng, path(rng)


def registered(truth: np.ndarray, rng: np.random.Generator, wrong: int = 0) -> Registered:
    """Consecutive scans and some loops, within their covariance of the truth; `wrong` of them anything."""
    T = poses_of(truth)
    i = np.concatenate([np.arange(len(truth) - 1), np.arange(0, len(truth) - 3, 4)])
    j = np.concatenate([np.arange(1, len(truth)), np.arange(3, len(truth), 4)])
    xi = rng.normal(size=(len(i), 6)) * np.sqrt(np.diag(TIGHT))
    T_i_j = T[i].inv() * T[j] * RigidTransform.from_components(xi[:, 3:], Rotation.from_rotvec(xi[:, :3]))
    R, t = T_i_j.rotation.as_matrix(), T_i_j.translation
    for k in rng.choice(len(i), wrong, replace=False).tolist():
        R[k], t[k] = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 3, 3)
    T_i_j = RigidTransform.from_components(t, Rotation.from_matrix(R))
    return Registered(i, j, T_i_j, np.tile(TIGHT, (len(i), 1, 1)))


def measured(truth: np.ndarray, rng: np.random.Generator, known: np.ndarray = ALL) -> np.ndarray:
    """(n, 6) with the instruments' errors; NaN where they measure nothing."""
    return np.where(known, truth + rng.normal(size=truth.shape) * SIGMAS, np.nan)


def priors(values: np.ndarray) -> list[PosePrior | None]:
    return [prior_of(row, SIGMAS) if np.isfinite(row).any() else None for row in values]


def exchanged(values: np.ndarray) -> np.ndarray:
    return values[:, [0, 1, 2, 4, 3, 5]]


def signed(column: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values * np.where(np.arange(6) == column, -1, 1)


SIGN, YAW = "heading_deg with the opposite sign", "heading_deg as a yaw, counterclockwise from East"
MISTAKES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    SIGN: signed(2),
    YAW: lambda v: np.column_stack([v[:, :2], 90 - v[:, 2], v[:, 3:]]),
    "heading_deg turned by 90 degrees": lambda v: v - np.array([0, 0, 90, 0, 0, 0]),
    "roll_deg with the opposite sign": signed(0),
    "pitch_deg with the opposite sign": signed(1),
    "roll_deg and pitch_deg exchanged": lambda v: v[:, [1, 0, 2, 3, 4, 5]],
    "East and North exchanged": exchanged,
    "depths in feet": lambda v: v / np.array([1, 1, 1, 1, 1, 0.3048]),
    "depth_m with the opposite sign": signed(5),
    "angles in radians": lambda v: v * np.array([np.pi / 180] * 3 + [1] * 3),
    "the rows of the scans before": lambda v: np.roll(v, 1, axis=0),
    "the rows of the scans after": lambda v: np.roll(v, -1, axis=0),
}


@pytest.mark.parametrize("name", list(MISTAKES))
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 3))])
def test_mistakes_are_named(name: str, seed: int) -> None:
    rng, truth = drawn([3, seed])
    verdict = contradiction(priors(MISTAKES[name](measured(truth, rng))), registered(truth, rng, wrong=seed % 3))
    assert verdict is not None
    assert verdict.instead[0] == name, verdict
    assert next(iter(verdict.remedies(1.0))) in replace(verdict, instead=(name,)).remedies(1.0)
    assert str(verdict).startswith("the scans contradict the navigation (")


@pytest.mark.parametrize(
    ("axes", "scale", "name"),
    [
        (np.diag([1.0, -1, 1]), 1.0, "scans mirrored, left for right"),
        (Rotation.from_euler("X", 180, degrees=True).as_matrix(), 1.0, "scans upside down"),
        (np.eye(3), 1000.0, "scans a thousand times smaller"),
        (np.eye(3), 0.001, "scans a thousand times larger"),
    ],
)
def test_mirrored_upside_down_and_scaled_scans_are_named(axes: np.ndarray, scale: float, name: str) -> None:
    """Points p of every scan became scale axes p, so a pair's p_i = R p_j + t holds for the changed R and t."""
    rng, truth = drawn(4)
    pairs, values = registered(truth, rng), measured(truth, rng)
    R, t = pairs.T_i_j.rotation.as_matrix(), pairs.T_i_j.translation
    changed = RigidTransform.from_components(
        scale * (axes @ t[:, :, None])[:, :, 0], Rotation.from_matrix(axes @ R @ axes.T)
    )
    verdict = contradiction(priors(values), Registered(pairs.i, pairs.j, changed, pairs.covariances))
    assert verdict is not None
    assert verdict.instead == (name,)


@pytest.mark.parametrize("known", [ALL, np.array([1, 1, 0, 0, 0, 1], bool), np.array([1, 1, 1, 0, 0, 1], bool)])
def test_costs_equal_those_of_pairs_of_priors(known: np.ndarray) -> None:
    """RelativePrior works a pair at a time, and halves the lever arm where both measure the shift: second order."""
    rng, truth = drawn(9)
    values, exact = measured(truth, rng, known), registered(truth, rng)
    exact = Registered(exact.i, exact.j, exact.T_i_j, np.zeros((len(exact.i), 6, 6)))
    of_scans = priors(values)
    costs = pair_costs(values, np.tile(SIGMAS * UNITS, (len(truth), 1)), exact)
    for row, (i, j) in enumerate(zip(exact.i.tolist(), exact.j.tolist(), strict=True)):
        target, source = of_scans[i], of_scans[j]
        assert target is not None
        assert source is not None
        squared, count = RelativePrior(target, source).normalized(exact.T_i_j[row])
        assert costs[row, 1] == count
        assert costs[row, 0] == pytest.approx(min(squared, 100), rel=0.2, abs=0.3)


@pytest.mark.parametrize(("latitude", "longitude"), [(60.0, 10.0), (-33.0, 151.0 - 180), (44.0, 9.0)])
def test_exchanged_latitude_and_longitude_are_named(latitude: float, longitude: float) -> None:
    """Taken for each other: a meter North is as many degrees as one East is at latitude 0, and cos(latitude) less."""
    rng, truth = drawn(12)
    truth[:, 3:5] *= 4
    values, pairs = measured(truth, rng), registered(truth, rng)
    north, east = values[:, 4].copy(), values[:, 3].copy()
    values[:, 4] = east / np.cos(np.radians(latitude))
    values[:, 3] = north * np.cos(np.radians(longitude))
    verdict = contradiction(priors(values), pairs, (longitude, latitude))
    assert verdict is not None
    assert verdict.instead[0] == "latitude and longitude exchanged"
    assert "--nav-columns with the names of both columns exchanged" in verdict.remedies(1.0)


def test_positions_in_feet_mirrored_or_at_other_times_are_named() -> None:
    rng, truth = drawn(8)
    pairs, values = registered(truth, rng), measured(truth, rng)
    for name, changed in {
        "places in feet": values / np.array([1, 1, 1, 0.3048, 0.3048, 1]),
        "places and depths in feet": values / np.array([1, 1, 1, 0.3048, 0.3048, 0.3048]),
        "East with the opposite sign": signed(3)(values),
        "North with the opposite sign": signed(4)(values),
        "the rows 3 scans before": np.roll(values, 3, axis=0),
    }.items():
        verdict = contradiction(priors(changed), pairs)
        assert verdict is not None, name
        assert verdict.instead[0] == name
        assert verdict.remedies(1.0)
    far = truth * np.array([1, 1, 1, 5, 5, 1])
    turned = contradiction(priors(measured(far, rng) - np.array([0, 0, 31, 0, 0, 0])), registered(far, rng))
    assert turned is not None
    (name,) = turned.instead
    assert int(name.split()[3]) == pytest.approx(31, abs=4), name
    opposite = contradiction(priors(values * np.array([1, 1, 1, -1, -1, 1])), pairs)
    assert opposite is not None
    assert set(opposite.instead) == {"East and North with their signs turned", "heading_deg turned by 180 degrees"}


@pytest.mark.parametrize("times", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_errors_larger_than_stated_are_not_named_as_mistakes(times: float) -> None:
    """Feet would make noisy depths and places agree better."""
    for seed, kind in enumerate([[0, 1], [3, 4], [5]]):
        rng, truth = drawn([13, seed])
        values = truth + rng.normal(size=truth.shape) * SIGMAS * np.where(np.isin(np.arange(6), kind), times, 1)
        assert contradiction(priors(values), registered(truth, rng)) is None


def test_correct_navigation_has_no_mistake() -> None:
    for seed in range(5):
        rng, truth = drawn([6, seed])
        known = ALL if seed % 2 else np.array([1, 1, seed % 3 == 0, 0, 0, 1], bool)
        assert contradiction(priors(measured(truth, rng, known)), registered(truth, rng, wrong=seed % 4)) is None


def test_noise_and_another_dive_are_not_named_as_mistakes() -> None:
    """Noise, and another dive's navigation."""
    for seed in range(3):
        rng, truth = drawn([7, seed])
        pairs, values = registered(truth, rng), measured(truth, rng)
        assert contradiction(priors(measured(path(rng), rng)), pairs) is None
        assert contradiction(priors(values + rng.normal(0, 20, values.shape)), pairs) is None


def test_too_few_pairs_have_no_mistake() -> None:
    rng, truth = drawn(8)
    values, pairs = signed(2)(measured(truth, rng)), registered(truth, rng)
    few, none = (Registered(pairs.i[:n], pairs.j[:n], pairs.T_i_j[:n], pairs.covariances[:n]) for n in (5, 0))
    assert contradiction(priors(values), few) is None
    assert contradiction(priors(values), none) is None
    assert contradiction([None] * len(truth), registered(truth, rng)) is None


def test_mistakes_with_the_same_effect_are_named_together() -> None:
    """Without places a heading of the other sign is a yaw as well."""
    rng, truth = drawn(5)
    values = MISTAKES[SIGN](measured(truth, rng, np.array([1, 1, 1, 0, 0, 1], bool)))
    verdict = contradiction(priors(values), registered(truth, rng))
    assert verdict is not None
    assert set(verdict.instead) == {SIGN, YAW}
