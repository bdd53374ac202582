"""How many prepared scans a worker keeps."""

from types import SimpleNamespace
from typing import Any

import pytest

from slam.execute.worker import prepared_limit


@pytest.mark.parametrize(("memory", "prepared"), [(2**40, 8), (2**26, 2)])
def test_as_many_scans_stay_prepared_as_fit(memory: int, prepared: int) -> None:
    registrar: Any = SimpleNamespace(device=SimpleNamespace(memory=memory), grid=SimpleNamespace(edge=128))
    assert prepared_limit(registrar) == prepared


def test_a_method_without_a_device_keeps_the_most() -> None:
    registrar: Any = SimpleNamespace()
    assert prepared_limit(registrar) == 8
