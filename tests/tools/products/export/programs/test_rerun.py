"""map.mcap in Rerun's command, where it is installed: no complaint, and every topic as something that it draws."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from sonarmap.tools.products.export.mcap import write_mcap
from tests.tools.products.export.poses import dive

DRAWN = {  # topics, and what Rerun makes of them
    "/map/points": "Points3D:positions",
    "/track/points": "Points3D:positions",
    "/tf": "Transform3D:translation",
    "/pose": "InstancePoses3D:translations",
    "/position": "GeoPoints:positions",
}


def test_topics(tmp_path: Path) -> None:
    command = shutil.which("rerun")
    if command is None:
        pytest.skip("Rerun is not installed: pip install rerun-sdk")
    earth = dive()
    write_mcap(tmp_path / "map.mcap", earth.folder, earth.part, earth)

    def rerun(*words: str | Path) -> str:
        return subprocess.run([command, *words], capture_output=True, text=True, check=True).stdout

    says = rerun("mcap", "check", tmp_path / "map.mcap")
    checked = re.findall(r"^(\w+) +\d+ +\d+ +(/\S+) +(\S+)$", says, re.MULTILINE)
    assert sorted(checked) == sorted(("ok", topic, "—") for topic in [*DRAWN, "/track"])
    rerun("mcap", "convert", tmp_path / "map.mcap", "-o", tmp_path / "map.rrd")
    chunks = rerun("rrd", "print", tmp_path / "map.rrd")
    for topic, component in DRAWN.items():
        assert re.search(rf" - {topic} - data columns: \[.*{component}", chunks), topic
