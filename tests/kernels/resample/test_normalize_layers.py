"""Normalization of layers equals NumPy's within 1e-5 of their unit variance."""

import numpy as np
import pytest

from sonarmap.kernels.resample.layers import normalize_layers, rotational_unwrap, valid_pixels


@pytest.mark.parametrize("shape", [(1, 8, 8), (77, 9, 24)])
@pytest.mark.parametrize("masked", [False, True])
def test_equals_the_twin(device, shape, masked):
    rng = np.random.default_rng(shape[0])
    scale, mean = rng.uniform(5, 50, (2, shape[0], 1, 1))
    stack = (mean + scale * rng.normal(size=shape)).astype(np.float32)
    window = rng.uniform(0, 1, shape[1:]).astype(np.float32)
    mask = (rng.uniform(size=shape[1:]) < 0.7).astype(np.float32) if masked else np.ones(shape[1:], np.float32)
    inside = stack[:, mask > 0].astype(np.float64)
    want = (stack - inside.mean(axis=1)[:, None, None]) / inside.std(axis=1)[:, None, None] * window * mask
    upload = device.to_device
    got = normalize_layers(device, upload(stack), upload(window), upload(mask) if masked else None).get()
    np.testing.assert_allclose(got, want, atol=1e-5)
    there = upload(stack)
    assert normalize_layers(device, there, upload(window), upload(mask), out=there) is there
    np.testing.assert_array_equal(there.get(), got)


def test_large_mean_costs_no_precision(device):
    stack = (5000 + np.random.default_rng(1).normal(size=(3, 64, 64))).astype(np.float32)
    exact = stack.astype(np.float64)
    want = (exact - exact.mean(axis=(1, 2), keepdims=True)) / exact.std(axis=(1, 2), keepdims=True)
    got = normalize_layers(device, device.to_device(stack), None).get()
    np.testing.assert_allclose(got, want, atol=2e-3)


def test_constant_layers_and_masked_values_give_zeros(device):
    stack = np.full((3, 16, 16), 0.1, np.float32)
    stack[1], stack[2] = 0, 12345.678
    mask = valid_pixels(rotational_unwrap(16))
    stack[:, mask == 0] = np.nan
    got = normalize_layers(device, device.to_device(stack), None, device.to_device(mask)).get()
    assert not got.any()
    empty = device.to_device(np.zeros((16, 16), np.float32))
    assert not normalize_layers(device, device.to_device(stack), None, empty).get().any()
