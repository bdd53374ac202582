"""Turn rates of recordings: about the axes of the clouds, from bags of every kind and recordings of a Sonar 3D-15."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap import map_scans
from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.odometry import turn_rates_of
from sonarmap.tools.files.readers.navigation.recorded import recorded_turn_rates
from sonarmap.tools.files.readers.scans import read_survey
from sonarmap.tools.files.readers.sonar.recording import turn_rates
from tests.samples.bags.messages import CLOUD, FIELDS, STAMP, TF, cloud, header, transforms, xyz
from tests.samples.bags.writers import WRITERS, Record, write_mcap
from tests.samples.cloud_files import TABLE, sonar_packets
from tests.samples.clutter_scans import sonarmap
from tests.samples.recordings import START, imu_packets
from tests.samples.refusals import refuses

IMU = "sensor_msgs/msg/Imu"
HALF = np.sqrt(0.5)
RATES = np.array([[0.5, -0.25, 0.125], [0.25, 1.0, -0.5], [-1.0, 0.5, 0.75]])
TIMES = STAMP + np.array([0.125, 0.25, 0.5])
SCAN = Scan(np.eye(3, dtype=np.float32), times=np.array([0.0, 0.1, 0.3], np.float32))


def imu(topic: str = "/imu", frame: str = "imu_link", count: int = 3) -> list[Record]:
    """Samples that were recorded an eighth of a second late."""
    return [
        (topic, IMU, time + 0.125, {"header": header(time, frame), "angular_velocity": xyz(rate)})
        for time, rate in zip(TIMES.tolist()[:count], RATES.tolist(), strict=False)
    ]


@pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
def test_turn_rates_are_read_from_every_kind_of_recording(tmp_path: Path, writer: str) -> None:
    """Beside clouds and an IMU with fewer messages; a bag of several files is read by its files."""
    records = [("/p", CLOUD, STAMP - 1.0, cloud()), *imu("/other", count=2), *imu()]
    path = WRITERS[writer](tmp_path, records)
    read = read_survey([path])
    known = turn_rates_of(read.files, [*read.scans, SCAN])
    assert known is not None
    np.testing.assert_array_equal(known.times, TIMES)
    np.testing.assert_allclose(known.rates, RATES, atol=1e-12)
    assert turn_rates_of(read.files, read.scans) is None  # without times


def test_turn_rates_are_about_the_axes_of_the_clouds(tmp_path: Path) -> None:
    """By tf_static, a quarter turn to port; or by the frame's name."""
    x, y, z = RATES.T
    links = transforms((0.0, "base_link", "imu_link", (3, -0.5, -0.25), (0, 0, HALF, HALF)))
    mounted = write_mcap(tmp_path / "a.mcap", [("/tf_static", TF, 1.0, links), *imu()])
    np.testing.assert_allclose(recorded_turn_rates(mounted)[1], np.column_stack([-y, x, z]), atol=1e-12)
    named = write_mcap(tmp_path / "b.mcap", imu(frame="imu_frd"))
    np.testing.assert_allclose(recorded_turn_rates(named)[1], np.column_stack([x, -y, -z]), atol=1e-12)


def test_turn_rates_of_a_sonar_are_read_and_recordings_without_an_imu_refused(tmp_path: Path) -> None:
    sonar = tmp_path / "dive.sonar"
    sonar.write_bytes(b"".join(imu_packets(1.0, lambda _: np.array([0, 0, -9.81]), np.array([0.1, 0.2, -0.3]))))
    bare = write_mcap(tmp_path / "bare.mcap", [("/p", CLOUD, 1.0, cloud())])
    refuses("no messages of type sensor_msgs/msg/Imu", recorded_turn_rates, bare)
    assert turn_rates_of([bare, tmp_path / "a.ply"], [SCAN]) is None
    (tmp_path / "silent.sonar").write_bytes(sonar_packets()[0])
    refuses(r"silent\.sonar: no IMU batch in it", turn_rates, tmp_path / "silent.sonar")
    known = turn_rates_of([bare, sonar], [SCAN])
    assert known is not None
    np.testing.assert_allclose(known.times, int(START) + np.arange(100) / 100, atol=1e-6)
    np.testing.assert_allclose(known.rates, np.tile([0.1, -0.2, 0.3], (100, 1)), atol=1e-7)


def test_a_map_of_clouds_with_times_uses_turn_rates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From Python and the command line; without the recording's own IMU it has none."""
    names = ("x", "y", "z", "intensity", "t")
    table = np.column_stack([TABLE, np.linspace(0.0, 0.5, len(TABLE))])
    timed = [
        ("/p", CLOUD, 1.0 + k, cloud(k + table, STAMP + k, names=names, fields=(*FIELDS, ("t", "f4", 20))))
        for k in range(3)
    ]
    path, given = write_mcap(tmp_path / "a.mcap", [*timed, *imu()]), list[TurnRates | None]()

    def run(*arguments: object, turn_rates: TurnRates | None = None) -> None:
        given.append(turn_rates if len(arguments) < 9 else arguments[8])
        raise InputError("enough")

    monkeypatch.setattr(Mapper, "run", run)
    refuses("enough", map_scans, str(path))
    for flags in ((), ("--no-imu",), ("--set", "straighten=false")):
        assert "enough" in sonarmap("map", path, "-o", tmp_path / "out", *flags).stderr
    assert [rates is not None for rates in given] == [True, True, False, False]
    for rates in given[:2]:
        assert rates is not None
        np.testing.assert_allclose(rates.rates, RATES, atol=1e-12)
