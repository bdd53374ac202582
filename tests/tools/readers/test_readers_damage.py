"""Files cut anywhere, damaged anywhere, or garbage: refused or harmless, without a warning."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kernels.errors import InputError
from spectral.scan import Scan
from tests.samples.cloud_files import POINTS, SAMPLES, STRENGTH
from tools.readers.clouds.cloud import COORDINATE_LIMIT
from tools.readers.scans import FORMATS, read_scans

pytestmark = pytest.mark.filterwarnings("error")
NAMES = list(SAMPLES)
LINES_WITHOUT_COUNT = (".xyz", ".txt", ".csv")


def read(folder: Path, suffix: str, content: bytes) -> Scan:
    """Always the first scan, read from a file."""
    path = folder / f"scan{suffix}"
    path.write_bytes(content)
    return read_scans([path]).scans[0]


def check_usable(scan: Scan) -> None:
    assert len(scan.points) >= 1
    assert np.isfinite(scan.points).all()
    assert np.abs(scan.points).max() <= COORDINATE_LIMIT
    if scan.strength is not None:
        assert scan.strength.shape == (len(scan.points),)
        assert np.isfinite(scan.strength).all()
        assert (scan.strength >= 0).all()


@pytest.mark.parametrize("sample", [name for name in NAMES if name != "sonar"])
def test_a_file_cut_anywhere_is_refused(tmp_path, sample):
    suffix, content = SAMPLES[sample]
    for kept in range(len(content)):
        try:
            scan = read(tmp_path, suffix, content[:kept])
        except InputError:
            continue
        assert suffix in LINES_WITHOUT_COUNT, f"cut to {kept} of {len(content)} bytes"
        assert content[:kept].endswith((b"\r", b"\n"))
        np.testing.assert_array_equal(scan.points, POINTS[: len(scan.points)])
        np.testing.assert_array_equal(scan.strength, STRENGTH[: len(scan.points)])


def mutations(content: bytes, count: int, seed: int):
    """`content` with one to four bytes changed, lost or added."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        changed = bytearray(content)
        for _ in range(rng.integers(1, 5)):
            place = int(rng.integers(len(changed)))
            match rng.integers(4):
                case 0:
                    changed[place] ^= 1 << int(rng.integers(8))
                case 1:
                    changed[place] = int(rng.integers(256))
                case 2:
                    del changed[place]
                case _:
                    changed[place:place] = bytes([int(rng.choice(list(b"0129-+. \n\xff")))])
        yield bytes(changed)


@pytest.mark.parametrize("sample", NAMES)
def test_damaged_bytes_are_refused_or_harmless(tmp_path, sample):
    suffix, content = SAMPLES[sample]
    for changed in mutations(content, 150, seed=len(sample)):
        try:
            scan = read(tmp_path, suffix, changed)
        except InputError:
            continue
        check_usable(scan)


@pytest.mark.parametrize("sample", NAMES)
def test_wild_numbers_in_headers_are_refused_or_harmless(tmp_path, sample):
    """Every number of the first 400 bytes replaced in turn by ones that lie."""
    suffix, content = SAMPLES[sample]
    for number in re.finditer(rb"-?\d+", content[:400]):
        for lie in (
            b"-1",
            b"0",
            b"1000000000000",
            b"9" * 30,
            b"1e9",
            b"nan",
            b"99999999999999999999999999999999999",
        ):
            changed = content[: number.start()] + lie + content[number.end() :]
            try:
                scan = read(tmp_path, suffix, changed)
            except InputError:
                continue
            check_usable(scan)


BEGINNINGS = [b"", *(content[:length] for _, content in SAMPLES.values() for length in (8, 60, 150))]


@given(start=st.sampled_from(BEGINNINGS), rest=st.binary(max_size=300), suffix=st.sampled_from(sorted(FORMATS)))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_garbage_is_refused_or_harmless(tmp_path, start, rest, suffix):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            scan = read(tmp_path, suffix, start + rest)
        except InputError:
            return
    check_usable(scan)
