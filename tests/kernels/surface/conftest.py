"""Both flavors of every kernel, whatever the device is: a processor runs what is written for a GPU as well."""

import pytest

from kernels.device.device import Device


@pytest.fixture(params=[True, False], ids=["cpu", "gpu"], scope="session")
def flavored(request: pytest.FixtureRequest, device: Device) -> Device:
    flavored = Device(device.cl_device)
    flavored.__dict__["is_cpu"] = request.param
    return flavored
