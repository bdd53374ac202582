"""What a result's `seconds` count: the pair, not what a driver compiles at its first launch."""

from typing import Any

import pytest

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral import registration as spectral
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import registration as hemisphere
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.scan import Scan
from tests.samples.structures import structure


@pytest.mark.parametrize("module", [spectral, hemisphere])
def test_the_first_pair_does_not_count_what_is_compiled(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    maker = spectral.SpectralRegistrar if module is spectral else hemisphere.HemisphereRegistrar
    registrar: Any = maker(choose_device(), Grid(16, 1.6))
    clock, launched = [0.0], []
    monkeypatch.setattr(module, "perf_counter", lambda: clock[0])
    step, name = (registrar.so3, "candidates") if module is spectral else (registrar.hemisphere, "tilt")
    compute = getattr(step, name)

    def compiles_at_first(*arguments: Any) -> Any:
        clock[0] += 1.0 if launched else 100.0
        launched.append(name)
        return compute(*arguments)

    monkeypatch.setattr(step, name, compiles_at_first)
    pair: list[SpectralScan] = [registrar.prepare(Scan(structure(seed))) for seed in (1, 2)]
    first = registrar.register(*pair)
    assert 1 <= first.seconds < 100
    calls = len(launched) // 2
    assert registrar.with_voxel(1.7).register(*pair).seconds == first.seconds == calls
    assert len(launched) == 3 * calls
