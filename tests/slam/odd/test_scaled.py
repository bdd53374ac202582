"""Groups of scans whose ranges are scaled: which are named and by how much, and that there are none elsewhere."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.odd.odd_scan import Change
from sonarmap.slam.odd.scaled import ScaledScans, find_scaled
from sonarmap.slam.pair import Candidate
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.mapped import Mapped
from sonarmap.tools.products.output.faults import contradictions, faults
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT, VOXEL = 14, 0.5
TRUTH = ring_poses(COUNT, turns=0.4)
SCANS = scans_of(TRUTH)
NAMES = [scan.name for scan in SCANS]
GROUPS = {"last": range(7, COUNT), "first": range(5)}


class Stretching(KnowingRegistrar):
    """Says of each pair by which share the source is too short, as registrations do: a part of it, with scatter."""

    def __init__(self, seed: int, response: float = 0.15, bias: dict[int, float] | None = None) -> None:
        super().__init__(TRUTH, 1e-6 * np.eye(6))
        self.draws, self.response, self.bias = np.random.default_rng(seed), response, bias or {}

    def prepare(self, scan: Scan) -> Any:
        prepared: Any = super().prepare(scan)
        scale = float(np.median(scan.points / SCANS[prepared.index].points))
        prepared.share = self.response * np.log(scale) + self.bias.get(prepared.index, 0.0)
        return prepared

    def register(self, target: Any, source: Any) -> Registration:
        shorter = target.share - source.share + 6e-4 * self.draws.standard_t(4)
        return replace(super().register(target, source), overlap=0.7, evidence=(("stretch", shorter),))


def scaled_by(scale: float, group: Collection[int]) -> list[Scan]:
    return [Change(factor=scale).of(scan) if k in group else scan for k, scan in enumerate(SCANS)]


def found(group: Collection[int], scale: float, registrar: KnowingRegistrar) -> ScaledScans | None:
    """In what registrations of scans up to three apart say."""
    scans = scaled_by(scale, group)
    runner = PairRunner(Execution(Worker(registrar, 2)), scans, 0, None)
    near = [Candidate(i, i + apart, "loop") for apart in (1, 2, 3) for i in range(COUNT - apart)]
    return find_scaled(runner, scans, runner.register(near))


@pytest.mark.parametrize("scale", [1.03, 0.97])
@pytest.mark.parametrize("group", GROUPS)
def test_a_scaled_group_is_named_and_measured(group: str, scale: float) -> None:
    scaled = found(GROUPS[group], scale, Stretching(1))
    assert scaled is not None
    assert scaled.scans == tuple(GROUPS[group])
    assert abs(scaled.longer - np.log(scale)) < 2 * scaled.sigma < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_scatter_gives_no_group(seed: int) -> None:
    assert found([], 1.0, Stretching(seed)) is None


def test_estimates_that_do_not_respond_to_scaling_give_no_group() -> None:
    """As where one half looks longer for another reason, which a known change of its ranges then shows."""
    longer = dict.fromkeys(GROUPS["last"], 0.004)
    for response in (0.0, 0.9):
        assert found([], 1.0, Stretching(1, response, longer)) is None


def test_registrations_without_stretch_give_no_group() -> None:
    assert found(GROUPS["last"], 1.03, KnowingRegistrar(TRUTH, 1e-6 * np.eye(6))) is None


def test_scaled_group_is_the_first_fault_and_the_map_is_not_whole() -> None:
    result = Mapper(Stretching(1), VOXEL).run(scaled_by(1.03, GROUPS["last"]))
    words = contradictions(result)[0]
    assert words.startswith("ranges of scan7 to scan13 (7 scans of 14) are ")
    assert "% longer than those of the others" in words
    assert faults(result, NAMES)[0] == words
    assert not Mapped(result, NAMES, Path(), 0).whole
