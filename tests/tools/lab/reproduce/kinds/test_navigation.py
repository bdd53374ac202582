"""A registration beside navigation alone: the directions of its covariance, and what is counted along them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.lab.reproduce.answer import refused
from sonarmap.tools.lab.reproduce.kinds.navigation import directions, navigation_cells, navigation_covariance
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION, PRIORS
from sonarmap.tools.lab.reproduce.kinds.tables import navigation_beside, navigation_table
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from tests.tools.lab.reproduce.kinds.rows import fixed, row

SCAN = Scan(np.zeros((1, 3), np.float32))
PAIR = KindPair(
    kind="swath",
    number=0,
    seed=1,
    scene="seabed",
    target=SCAN,
    source=SCAN,
    T_world_target=RigidTransform.from_components([5.0, -3.0, -8.0], Rotation.from_euler("ZYX", [2.0, 0.1, -0.05])),
    T_world_source=RigidTransform.from_components([25.0, 22.0, -7.0], Rotation.from_euler("ZYX", [-1.0, 0.02, 0.1])),
    shared=0.3,
)


def navigated(pair: KindPair) -> tuple[PosePrior, PosePrior]:
    """What navigation measures of both scans."""
    instruments = PRIORS[NAVIGATION]
    assert instruments is not None
    given = pair.with_priors(instruments)
    assert given.target.prior is not None
    assert given.source.prior is not None
    return given.target.prior, given.source.prior


def registration(error: np.ndarray, sigmas: np.ndarray) -> Registration:
    """Off by `error` and with standard deviations `sigmas`, both along the source's axes [m]."""
    T = PAIR.T_target_source * RigidTransform.from_translation(error)
    return Registration(T, np.diag(np.concatenate([np.full(3, 1e-6), sigmas**2])), 20.0, 0.3, True, 1.0)


class TestCells:
    def test_directions_are_those_of_the_covariance_in_the_targets_axes(self) -> None:
        priors = navigated(PAIR)
        error = np.array([0.3, -2.0, 0.1])
        answer = registration(error, np.array([0.5, 3.0, 0.02]))
        found = directions(navigation_cells(answer, PAIR.T_target_source, *priors))
        assert [direction.sigma for direction in found] == pytest.approx([0.02, 0.5, 3.0])
        assert [abs(direction.error) for direction in found] == pytest.approx([0.1, 0.3, 2.0], abs=1e-6)
        T = priors[0].T_world_sensor.inv() * priors[1].T_world_sensor
        off = T.translation - PAIR.T_target_source.translation
        lengths = [np.linalg.norm([direction.navigation_error for direction in found]), np.linalg.norm(off)]
        assert lengths[0] == pytest.approx(lengths[1])
        assert [direction.is_fixed for direction in found] == [True, True, False]

    def test_the_covariance_of_navigation_is_that_of_its_errors(self) -> None:
        """Roll, pitch and heading turn the way to the source; positions and depths err besides."""
        draws = []
        for number in range(400):
            target, source = navigated(replace(PAIR, number=number))
            off = (target.T_world_sensor.inv() * source.T_world_sensor).translation - PAIR.T_target_source.translation
            draws.append(off @ np.linalg.solve(navigation_covariance(target, source), off))
        assert np.mean(draws) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 400))

    def test_a_refused_registration_has_none(self) -> None:
        assert navigation_cells(refused("why"), PAIR.T_target_source, *navigated(PAIR)) == {}
        assert directions(row()) == []


def along(relief: str, *cells: tuple[float, float, float], **changes: object) -> dict:
    """A row with navigation known, and sigma, error and navigation's error of some directions."""
    of_directions = [fixed(*three, number) for number, three in enumerate(cells, 1)]
    return row(priors=NAVIGATION, relief=relief, **{k: v for each in of_directions for k, v in each.items()}, **changes)


class TestTable:
    ROWS = (
        along("weak", (0.1, 0.05, 1.0), (0.2, -0.3, 1.2), (0.6, 0.9, -1.0)),
        along("rich", (0.1, 1.0, -2.0), (0.7, 0.1, 0.2), (0.8, 0.3, 0.4), accepted=False),
        along("flat", *[(1.0, 1, 1)] * 3),
        along("twins"),
        row(**fixed(0.1, 0.0, 1.0, 1)),
    )

    @pytest.mark.parametrize(
        ("relief", "cells"),
        [
            ("weak", "1|2.00|1.10|0.17|1/1 [0.21..1.00]|2/2 [0.34..1.00]|1.00|0.90"),
            ("rich", "1|1.00|2.00|1.00|0/1 [0.00..0.79]|0/1 [0.00..0.79]|0.30|0.20"),
            ("flat", "1|0.00|–|–|–|–|1.00|1.00"),
            ("twins", "1|–|–|–|–|–|–|–"),
            ("all but flat", "3|1.50|1.20|0.30|1/2 [0.09..0.91]|2/3 [0.21..0.94]|0.40|0.30"),
            ("all but flat, believed", "2|2.00|1.10|0.17|1/1 [0.21..1.00]|2/2 [0.34..1.00]|1.00|0.90"),
        ],
    )
    def test_errors_along_what_is_fixed_and_along_the_rest(self, relief: str, cells: str) -> None:
        assert {line[0]: "|".join(line[1:]) for line in navigation_table(self.ROWS).rows}[relief] == cells

    def test_beside_navigation_alone(self) -> None:
        error, covered = navigation_beside(self.ROWS)
        assert error[1:] == ("0.30 m", "navigation alone: 1.20 m", "registration leaves 25 % of navigation's error")
        assert covered[1] == "2/3 [0.21..0.94]"
        assert navigation_beside(self.ROWS[2:])[0][1] == "none in 1 pairs"
        assert navigation_beside([self.ROWS[2], self.ROWS[4]]) == []
