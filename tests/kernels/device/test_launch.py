"""Literals, poses, slices of arrays, and launches on devices that are full or small."""

from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from pyopencl._cl import _ErrorRecord

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import affine, launch, zero
from sonarmap.kernels.device.source import literal
from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.resample.layers import rectangular_unwrap, sample, upload_directions


class Limited:
    """A PyOpenCL device with some properties replaced."""

    def __init__(self, actual: object, **limits: Any) -> None:
        self._actual = actual
        self.__dict__.update(limits)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._actual, name)


def limited(device: Device, **limits: Any) -> Device:
    """A separate device with such properties, with kernels in the GPU flavor."""
    other = Device(device.cl_device, flavor="gpu")
    # pyrefly: ignore[bad-assignment]
    other.cl_device = Limited(device.cl_device, **limits)
    return other


def test_literals_read_back_to_the_same_bits():
    values = 64, np.int64(64), np.uint8(3), -2, 1.0, np.float32(0.5)
    assert [literal(value) for value in values] == ["64", "64", "3", "-2", "1.0f", "0.5f"]
    for value in np.random.default_rng(1).normal(size=100) * 10.0 ** np.arange(-30, 30)[:, None]:
        assert all(np.float32(literal(number)[:-1]) == np.float32(number) for number in value)


def test_pose_is_a_rotation_and_no_reflection():
    pose = affine(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([4.0, 5.0, 6.0]))
    assert np.array_equal([pose[f"s{k}"] for k in range(8)], [0, -1, 0, 4, 1, 0, 0, 5])
    for mirror in (np.diag([1.0, 1.0, -1.0]), -np.eye(3)):
        with pytest.raises(InputError, match=r"a reflection; wanted a .* rotation"):
            affine(mirror)


@pytest.mark.parametrize("edge", [16, 32])
def test_halves_of_a_stack_of_images_are_aligned_on_every_device(device, edge):
    """The tilt's layers are written to such halves. No driver is known to require more than 4096 bits."""
    radii = np.arange(1, edge // 2 - 2, dtype=np.float32)
    layers = len(radii)
    strict = limited(device, mem_base_addr_align=4096)
    magnitude = strict.to_device(np.random.default_rng(2).random((edge, edge, edge // 2 + 1), np.float32))
    stack = strict.empty((2 * layers, edge, edge))
    for part, axis in zip((stack[:layers], stack[layers:]), "yx", strict=True):
        directions = upload_directions(strict, rectangular_unwrap(edge, axis))
        sample(strict, magnitude, directions, radii, out=part)
        assert np.array_equal(part.get(), sample(strict, magnitude, directions, radii).get())


def test_unaligned_slice_is_refused(device):
    strict = limited(device, mem_base_addr_align=4096)
    wide = strict.to_device(np.zeros((16, 8), np.float32))
    with pytest.raises(InputError, match=r"begins 32 bytes into it; .* needs a multiple of 512"):
        launch(strict, "device/clear", "clear", (1,), wide[1:], BYTES=32)


@pytest.mark.parametrize("shape", [(1, 3), (2, 512), (3, 1024), (4, 999), (5, 16, 64)])
@pytest.mark.parametrize("dtype", [np.float32, np.complex64])
def test_zero_clears_exactly_the_array(device, shape, dtype):
    """Sizes with and without a remainder, whole arrays and a slice between others."""
    array = device.to_device(np.ones(shape, dtype))
    zero(device, array)
    assert not array.get().any()
    stack = device.to_device(np.ones((3, 8, 1024), dtype))
    zero(device, stack[1])
    assert not stack.get()[1].any()
    assert (stack.get()[[0, 2]] == 1).all()


class TestFull:
    """Drivers that allocate memory at its first use fail at a launch."""

    @pytest.mark.parametrize(
        ("kind", "code"),
        [
            (cl.MemoryError, cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE),
            (cl.RuntimeError, cl.status_code.OUT_OF_RESOURCES),
            (cl.RuntimeError, cl.status_code.OUT_OF_HOST_MEMORY),
        ],
    )
    def test_full_device_is_reported_at_every_launch(self, device, monkeypatch, kind, code):
        def fail(*_: object, **__: object) -> None:
            raise kind(_ErrorRecord(msg="clEnqueue failed: FULL", code=code, routine="clEnqueue"))

        fft, volume = RealFFT(device, (16, 16, 16)), device.to_device(np.zeros((16, 16, 16), np.float32))
        monkeypatch.setattr(cl, "enqueue_nd_range_kernel", fail)
        monkeypatch.setattr(cl, "enqueue_fill_buffer", fail)
        monkeypatch.setattr(cl.Kernel, "__call__", fail)
        calls = (
            lambda: fft.forward(volume),
            lambda: zero(device, volume),
            lambda: launch(device, "device/clear", "clear", (1,), volume, BYTES=32),
        )
        for call in calls:
            with pytest.raises(DeviceError, match=r"no memory .*left for this .*FULL.*Use a smaller `edge`"):
                call()

    def test_other_errors_are_not_reported_as_a_full_device(self, device, monkeypatch):
        def fail(*_: object, **__: object) -> None:
            code = cl.status_code.PROFILING_INFO_NOT_AVAILABLE
            raise cl.RuntimeError(_ErrorRecord(msg="other", code=code, routine="clEnqueue"))

        array = device.empty((16,))
        monkeypatch.setattr(cl, "enqueue_fill_buffer", fail)
        with pytest.raises(cl.RuntimeError, match="other"):
            zero(device, array)
