"""What the tests share: the device they run on."""

import pytest

from kernels.device import Device, choose_device


@pytest.fixture(scope="session")
def device() -> Device:
    return choose_device()
