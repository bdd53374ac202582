"""Real scans, where the folder of shared data lies beside the checkout: RGB-D fragments with truth, a real sonar."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from structures import difference
from typer.testing import CliRunner

from tools.cli.main import app
from tools.readers.tum import read_tum

SHARED = Path(__file__).parents[2] / "shared" / "data"
KITCHEN, SHIP = SHARED / "redkitchen", SHARED / "sonar3d15" / "ship_short.sonar"


def survey(out: Path, *inputs: Path) -> tuple[dict, list[RigidTransform]]:
    """The summary of `sonarmap map` and T_world_sensor of every scan."""
    result = CliRunner().invoke(app, ["map", *map(str, inputs), "-o", str(out), "--quiet"])
    assert result.exit_code == 0, result.output
    return json.loads((out / "summary.json").read_text()), list(read_tum(out / "trajectory.tum").T_world_sensor)


def registered(summary: dict) -> dict[tuple[int, int], RigidTransform]:
    """T_target_source of every pair, by its scans."""
    return {
        (row["target"], row["source"]): RigidTransform.from_matrix(np.array(row["T_target_source"]))
        for row in summary["pairs"]
    }


def true_transforms() -> dict[tuple[int, int], RigidTransform]:
    """gt.log: a line 'i j n' and the matrix that maps fragment j into fragment i."""
    rows = [line.split() for line in (KITCHEN / "gt.log").read_text().splitlines() if line.strip()]
    return {
        (int(head[0]), int(head[1])): RigidTransform.from_matrix(np.array(matrix, dtype=float))
        for head, *matrix in (rows[n : n + 5] for n in range(0, len(rows), 5))
    }


@pytest.mark.skipif(not KITCHEN.is_dir(), reason="shared/data/redkitchen is not beside the checkout")
def test_kitchen_fragments_come_out_as_the_truth_has_them(tmp_path: Path) -> None:
    """Within 6 degrees and 2 voxels, before the graph and after it."""
    summary, poses = survey(tmp_path, *sorted(KITCHEN.glob("*.ply")))
    voxel, truth = summary["settings"]["grid"]["voxel"], true_transforms()
    for i, j in pairwise(range(3)):
        for what, T in (("registered", registered(summary)[i, j]), ("optimized", poses[i].inv() * poses[j])):
            angle, distance = difference(T, truth[i, j])
            print(f"fragments {i}, {j} {what}: {angle:.2f} degrees, {distance / voxel:.2f} voxels of {voxel:.4f} m")
            assert angle < 6
            assert distance < 2 * voxel


@pytest.mark.skipif(not SHIP.is_file(), reason="shared/data/sonar3d15 is not beside the checkout")
def test_a_sonar_that_hardly_moves_is_told_to_hardly_move(tmp_path: Path) -> None:
    """Six frames within a second: steps under 3 degrees and 0.15 m, the whole way under 0.3 m."""
    summary, poses = survey(tmp_path, SHIP)
    assert len(poses) == 6
    steps = [registered(summary)[k, k + 1] for k in range(5)]
    chained = np.prod(np.array(steps, dtype=object))
    for k, step in enumerate(steps):
        angle, distance = difference(RigidTransform.identity(), step)
        print(f"frames {k}, {k + 1}: {angle:.2f} degrees, {distance:.3f} m")
        assert angle < 3
        assert distance < 0.15
    for what, whole in (("chained", chained), ("optimized", poses[0].inv() * poses[5])):
        angle, distance = difference(RigidTransform.identity(), whole)
        print(f"all six frames, {what}: {angle:.2f} degrees, {distance:.3f} m")
        assert distance < 0.3
