"""Inputs of the pages' commands: simulated scans, recordings and logs of one dive, under the names that the pages use.

All but `A` and `B` are of the same few scans of a flood gate, so that logs and scans belong together.
"""

import csv
import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from sonarmap.tools.files.readers.clouds.ply import read_ply
from sonarmap.tools.files.readers.trajectory import read_tum
from tests.samples.bags.messages import CLOUD, ODOMETRY, cloud, odometry
from tests.samples.bags.writers import write_ros1
from tests.samples.command_line import sonarmap
from tests.samples.dives import Dive
from tests.samples.lines import gsf_of, sample_of
from tests.samples.recordings import written
from tests.slam.pings.simulated_lines import simulated
from tests.tools.files.readers.pings.kmall_file import kmall

START = datetime(2026, 7, 1, 9, 30, tzinfo=UTC)
STEP = 10.0  # [s] between the scans
LATITUDE, LONGITUDE = 60.3913, 5.3221  # of the scene's origin
METERS = 111_320.0  # in a degree of latitude
ZONE = "EPSG:25832"
FIELDS = (("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8), ("intensity", "f4", 12))
EVERY = 3  # step between the points that bags keep of a cloud


class Inputs:
    """Makes each input once, in a folder of its own, and copies it to where a page's commands run."""

    def __init__(self, kept: Path) -> None:
        """`kept`: folder in which the inputs are made."""
        self.kept = kept

    def give(self, name: str, folder: Path) -> None:
        made = self.made(name)
        if made.is_dir():
            shutil.copytree(made, folder / name, dirs_exist_ok=True)
        else:
            shutil.copy(made, folder / name)

    def made(self, name: str) -> Path:
        """Path of the input, which the first call makes."""
        path = self.kept / name
        if not path.exists():
            INPUTS[name](self, path)
        return path

    def rows(self) -> list[dict[str, float]]:
        """Simulated measurements of navigation, one row per scan."""
        with (self.made("measured") / "priors.csv").open() as file:
            return [{key: float(cell) for key, cell in row.items() if key != "name"} for row in csv.DictReader(file)]

    def points(self, scan: int) -> np.ndarray:
        """(N, 4): x, y, z [m, sensor frame] and the strength."""
        (found,) = read_ply((self.made("scans") / f"scan_{scan:03d}.ply").read_bytes())
        assert found.strength is not None
        return np.column_stack([found.points, found.strength])


def time_of(scan: int) -> datetime:
    return START + timedelta(seconds=STEP * scan)


def moment(scan: int) -> str:
    return f"{time_of(scan):%Y-%m-%dT%H:%M:%SZ}"


def write_rows(path: Path, columns: list[str], rows: list[tuple[str | float, ...]], between: str = ",") -> None:
    """A table of texts and of numbers to 0.1 mm."""
    lines = [columns, *([cell if isinstance(cell, str) else f"{cell:.4f}" for cell in row] for row in rows)]
    path.write_text("".join(between.join(line) + "\n" for line in lines))


def place_of(row: dict[str, float]) -> tuple[float, float]:
    """Latitude and longitude [deg]."""
    latitude = LATITUDE + row["y_m"] / METERS
    return latitude, LONGITUDE + row["x_m"] / (METERS * np.cos(np.deg2rad(LATITUDE)))


def made_by(line: str, *names: str) -> Callable[[Inputs, Path], None]:
    """An input that a command writes from the inputs of these names."""

    def make(inputs: Inputs, path: Path) -> None:
        ended = sonarmap(*line.split(), *(str(inputs.made(name)) for name in names), "-o", str(path))
        assert ended.returncode == 0, ended.stderr

    return make


def dive_folder(inputs: Inputs, path: Path) -> None:
    """Write the scans with stamps."""
    path.mkdir()
    for k in range(len(inputs.rows())):
        table = inputs.points(k)
        stamp = time_of(k).timestamp()
        np.savez(path / f"scan_{k}.npz", points=table[:, :3].astype(np.float32), strength=table[:, 3], stamp=stamp)


def sonar_recording(inputs: Inputs, path: Path) -> None:
    written(path, Dive("rubble", shots=24, rate=1.0, speed=0.5).packets())


def bag(inputs: Inputs, path: Path) -> None:
    """A bag of clouds and dead reckoning of the dive."""
    poses = read_tum(inputs.made("scans") / "truth.tum").T_world_sensor
    records = []
    for k in range(len(inputs.rows())):
        stamp = time_of(k).timestamp()
        table = inputs.points(k)[::EVERY]
        clouds = cloud(table, stamp, "base_link", fields=FIELDS, step=16)
        records.append(("/sonar/points", CLOUD, stamp, clouds))
        T = poses[0].inv() * poses[k]
        turn = T.rotation.as_quat(canonical=True)
        records.append(("/dvl/odom", ODOMETRY, stamp, odometry(stamp, T.translation.tolist(), turn.tolist())))
    write_ros1(path, records)


def vehicle_log(inputs: Inputs, path: Path) -> None:
    names = ("roll_deg", "pitch_deg", "heading_deg", "depth_m")
    rows = [(moment(k), *(row[name] for name in names)) for k, row in enumerate(inputs.rows())]
    write_rows(path, ["Time (UTC)", "Roll (deg)", "Pitch (deg)", "Heading (deg)", "Depth (m)"], rows)


def named_log(inputs: Inputs, path: Path) -> None:
    """A log by scan names, without standard deviations."""
    names = ("roll_deg", "pitch_deg", "heading_deg", "x_m", "y_m", "depth_m")
    rows = [(f"scan_{k:03d}", *(row[name] for name in names)) for k, row in enumerate(inputs.rows())]
    write_rows(path, ["name", *names], rows)


def grid_log(inputs: Inputs, path: Path) -> None:
    """A log of eastings, northings and grid headings."""
    from pyproj import Proj, Transformer

    convert, grid = Transformer.from_crs("EPSG:4326", ZONE, always_xy=True), Proj(ZONE)
    rows = []
    for k, row in enumerate(inputs.rows()):
        latitude, longitude = place_of(row)
        easting, northing = convert.transform(longitude, latitude)
        heading = row["heading_deg"] - grid.get_factors(longitude, latitude).meridian_convergence
        rows.append((moment(k), easting, northing, row["depth_m"], heading % 360, row["roll_deg"], row["pitch_deg"]))
    write_rows(path, ["Time (UTC)", "Easting", "Northing", "Depth (m)", "Heading", "Roll", "Pitch"], rows, "\t")


def nmea_log(inputs: Inputs, path: Path) -> None:
    """A sentence of each kind per second, as a ship's computer records them."""
    rows = inputs.rows()
    seconds = np.arange(0, STEP * (len(rows) - 1) + 1)
    between = {name: np.interp(seconds, STEP * np.arange(len(rows)), [row[name] for row in rows]) for name in rows[0]}
    sentences: list[str] = []
    for k in range(len(seconds)):
        row = {name: float(values[k]) for name, values in between.items()}
        now = START + timedelta(seconds=float(seconds[k]))
        (north, east) = place_of(row)
        latitude = f"{int(north):02d}{north % 1 * 60:010.7f}"
        longitude = f"{int(east):03d}{east % 1 * 60:010.7f}"
        sentences.append(f"GPZDA,{now:%H%M%S}.00,{now:%d,%m,%Y},00,00")
        sentences.append(f"GPGGA,{now:%H%M%S}.00,{latitude},N,{longitude},E,4,12,0.8,0.0,M,0.0,M,,")
        sentences.append(f"HEHDT,{row['heading_deg'] % 360:.2f},T")
    path.write_text("".join(f"${text}*{checksum(text):02X}\r\n" for text in sentences))


def checksum(sentence: str) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(sentence.encode(), np.uint8)))


def one_scan(number: int) -> Callable[[Inputs, Path], None]:
    def make(inputs: Inputs, path: Path) -> None:
        if path.suffix == ".npy":
            np.save(path, inputs.points(number)[:, :3])
        else:
            shutil.copy(inputs.made("scans") / f"scan_{number:03d}.ply", path)

    return make


def ties(inputs: Inputs, path: Path) -> None:
    path.write_text("target,source,verdict,note\nscan_000,scan_003,add,the same pillar\nscan_001,scan_006,reject,\n")


def control(inputs: Inputs, path: Path) -> None:
    """Control points: one of every other scan, with its true position."""
    poses = read_tum(inputs.made("scans") / "truth.tum").T_world_sensor
    points = {k: inputs.points(k)[100 * k, :3] for k in range(0, len(poses), 2)}
    rows = [(f"mark {k}", f"scan_{k:03d}", *p, *poses[k].apply(p), 0.5) for k, p in points.items()]
    write_rows(path, ["name", "scan", "x_m", "y_m", "z_m", "east_m", "north_m", "up_m", "sigma_m"], rows)


def graph(inputs: Inputs, path: Path) -> None:
    shutil.copy(inputs.made("map") / "graph.g2o", path)


def settings(inputs: Inputs, path: Path) -> None:
    path.write_text('[map]\nexport = ["mcap"]\nreport = false\n')


GATE, HARBOR = "simulate --scene floodgate --scans 8 --seed 1", "simulate --scene harbor --scans 4 --dive"


def one_line(number: int) -> Callable[[Inputs, Path], None]:
    """A line of an echo sounder, which overlaps with the next."""

    def make(inputs: Inputs, path: Path) -> None:
        line = simulated(5, rms=0.6, pings=120, beams=96).recorded[number]
        if path.suffix == ".kmall":
            path.write_bytes(kmall(sample_of(line)))
        else:
            gsf_of(path, line)

    return make


INPUTS: dict[str, Callable[[Inputs, Path], None]] = {
    "scans": made_by(GATE),
    # the same scans with measurements of navigation
    "measured": made_by(f"{GATE} --priors attitude,heading,depth,position --fix-sigma 1"),
    "map": made_by("map --grid 64", "scans"),
    "dive": dive_folder,
    "A": made_by(f"{HARBOR} 1"),
    "B": made_by(f"{HARBOR} 2"),
    "both": made_by("map --grid 64", "A", "B"),
    "survey.sonar": sonar_recording,
    "dive.sonar": sonar_recording,
    "dive.bag": bag,
    "rov.csv": vehicle_log,
    "nav.csv": named_log,
    "survey.txt": grid_log,
    "ship.nmea": nmea_log,
    "target.ply": one_scan(0),
    "source.ply": one_scan(1),
    "A.ply": one_scan(0),
    "B.ply": one_scan(1),
    "target.npy": one_scan(0),
    "source.npy": one_scan(1),
    **{f"line{k + 1}.{suffix}": one_line(k) for suffix in ("gsf", "kmall") for k in (0, 1)},
    "in.g2o": graph,
    "ties.csv": ties,
    "control.csv": control,
    "survey.toml": settings,
}
