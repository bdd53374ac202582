"""Key scans saved for a restart: read back bit by bit, all of them or up to the first damaged one."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.pair_text import to_text
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.command.live.kept_keys import KeptKey, forget_keys, has_keys, keep_key, kept_for, kept_keys
from sonarmap.tools.files.readers.incoming import Mark
from tests.samples.clutter_scans import scan


def key(number: int) -> KeptKey:
    """A key with a prior, except for number 0, and a step, except for number 1."""
    T = RigidTransform.from_components([0.1 * number, -2.3, 4.7], Rotation.from_rotvec([0.1, 0.2 * number, -0.3]))
    sigmas = np.array([0.01, 0.02, np.inf, 0.3, 0.5, np.inf])
    prior = PosePrior(T, sigmas) if number else None
    cloud = Scan(scan(number % 4)[: 50 + number], stamp=1.7e9 + number / 7, prior=prior, name=f"001#{3 * number}")
    return KeptKey(cloud, step(number) if number != 1 else None, Mark("001.sonar", 12345 * number), 0.175)


def step(number: int) -> Registration:
    rng = np.random.default_rng(number)
    T = RigidTransform.from_components(rng.normal(size=3), Rotation.from_rotvec(rng.normal(size=3) / 9))
    root = rng.normal(size=(6, 6))
    return Registration(
        T, root @ root.T, 21.7, 0.43, True, 0.9, "so", 0.97, (("translation", 21.7),), evidence=(("fixed", 0.9),)
    )


def keep(out: Path, count: int) -> list[KeptKey]:
    keys = [key(number) for number in range(count)]
    for number, each in enumerate(keys):
        keep_key(out, number, each)
    return keys


def test_keys_are_read_back_bit_by_bit(tmp_path: Path) -> None:
    given = keep(tmp_path, 3)
    found = list(kept_keys(tmp_path))
    assert len(found) == 3
    for written, read in zip(given, found, strict=True):
        assert written.scan.points.tobytes() == read.scan.points.tobytes()
        assert (written.scan.stamp, written.scan.name, written.behind, written.voxel) == (
            read.scan.stamp, read.scan.name, read.behind, read.voxel,
        )  # fmt: skip
        assert (written.step and to_text(written.step)) == (read.step and to_text(read.step))
        assert (written.scan.prior is None) == (read.scan.prior is None)
        if written.scan.prior is not None and read.scan.prior is not None:
            np.testing.assert_array_equal(written.scan.prior.sigmas, read.scan.prior.sigmas)
            T, U = written.scan.prior.T_world_sensor, read.scan.prior.T_world_sensor
            np.testing.assert_allclose(T.as_matrix(), U.as_matrix(), rtol=0, atol=1e-15)


@pytest.mark.parametrize("damage", ["cut", "empty", "changed", "gone"])
def test_reading_stops_at_a_damaged_or_missing_key(tmp_path: Path, damage: str) -> None:
    keep(tmp_path, 4)
    path = sorted((tmp_path / "live").glob("key_*.npz"))[2]
    whole = path.read_bytes()
    if damage == "gone":
        path.unlink()
    else:
        changed = whole[:200] + bytes([whole[200] ^ 4]) + whole[201:]
        path.write_bytes({"cut": whole[:-30], "empty": b"", "changed": changed}[damage])
    alerts = list[str]()
    assert [kept.scan.name for kept in kept_keys(tmp_path, alerts.append)] == ["001#0", "001#3"]
    assert alerts == [] if damage == "gone" else [f"{path} is damaged and left out; what it held is mapped again"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("voxel", float("nan")), ("stamp", "soon"), ("prior", [[[1.0]], [0.1]]), ("step", 7)),
        ("behind", {"file": "a", "count": "7", "shots": 0}),
    ],
)
def test_reading_stops_at_an_invalid_value(tmp_path: Path, name: str, value: object) -> None:
    """The file has valid checksums."""
    keep(tmp_path, 3)
    path = tmp_path / "live" / "key_00001.npz"
    with np.load(path) as arrays:
        points, said = arrays["points"], json.loads(arrays["said"].tobytes())
    said[name] = value
    np.savez(path, points=points, said=np.frombuffer(json.dumps(said).encode(), np.uint8))
    alerts = list[str]()
    assert [kept.scan.name for kept in kept_keys(tmp_path, alerts.append)] == ["001#0"]
    assert alerts == [f"{path} is damaged and left out; what it held is mapped again"]


def test_other_inputs_delete_keys_and_the_same_keep_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    with kept_for(out, ["dive"]):
        keep(out, 2)
    leftover = out / "live" / ".sonarmap.0123.npz"
    leftover.write_bytes(b"of a run that was killed")
    with kept_for(out, [str(tmp_path / "dive")]):
        assert len(list(kept_keys(out))) == 2
    assert not leftover.exists()
    with kept_for(out, ["dive 2"]):
        assert not has_keys(out)


def test_forget_keys_leaves_other_files(tmp_path: Path) -> None:
    keep(tmp_path, 2)
    other = tmp_path / "live" / "notes.npz"
    other.write_bytes(b"7")
    forget_keys(tmp_path)
    assert list((tmp_path / "live").iterdir()) == [other]


def test_the_folder_is_locked_until_the_first_run_ends(tmp_path: Path) -> None:
    with kept_for(tmp_path, ["a"]), pytest.raises(InputError, match="is in use"), kept_for(tmp_path, ["a"]):
        pass
    with kept_for(tmp_path, ["a"]):
        keep(tmp_path, 1)
    assert has_keys(tmp_path)
