"""Real scans, where the folder of shared data lies beside the checkout: RGB-D fragments with truth, a real sonar."""

import json
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from structures import difference
from typer.testing import CliRunner

from spectral.grid import Grid, choose_grid
from spectral.result import Registration
from spectral.scan import Scan
from tools.cli.main import app
from tools.methods import build
from tools.readers import read_scans
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


def registrations(*inputs: Path) -> tuple[tuple[Scan, ...], Grid, dict[tuple[int, int], Registration]]:
    """Every pair of the scans by the default method, with nothing but its defaults."""
    scans = read_scans(inputs).scans
    grid = choose_grid(scans)
    registrar = build("spectral", grid)
    prepared = [registrar.prepare(scan) for scan in scans]
    pairs = combinations(range(len(scans)), 2)
    return scans, grid, {(i, j): registrar.register(prepared[i], prepared[j]) for i, j in pairs}


@pytest.mark.skipif(not KITCHEN.is_dir(), reason="shared/data/redkitchen is not beside the checkout")
def test_kitchen_fragments_are_registered_as_the_truth_has_them() -> None:
    """All pairs within 3 degrees, and within a voxel at the middle of the source's points; all believed.

    The fragments lie 1 to 4 m before their origin, so that a degree moves the origin by a voxel or two.
    """
    scans, grid, found = registrations(*sorted(KITCHEN.glob("*.ply")))
    truth = true_transforms()
    for (i, j), registration in found.items():
        T = registration.T_target_source
        middle = scans[j].points.mean(axis=0)
        angle, origin = difference(T, truth[i, j])
        off = float(np.linalg.norm(T.apply(middle) - truth[i, j].apply(middle)))
        print(
            f"fragments {i}, {j}: {angle:.2f} degrees, {off / grid.voxel:.2f} voxels of {grid.voxel:.4f} m, "
            f"{origin / grid.voxel:.2f} at the origin; probability {registration.probability:.4f}"
        )
        assert registration.accepted
        assert angle < 3
        assert off < grid.voxel


@pytest.mark.skipif(not SHIP.is_file(), reason="shared/data/sonar3d15 is not beside the checkout")
def test_frames_of_a_sonar_agree_with_their_mean_chain(tmp_path: Path) -> None:
    """Each of the 15 pairs of six frames within 1 degree and 3 cm of what the optimized chain says; all believed."""
    _, _, found = registrations(SHIP)
    _, poses = survey(tmp_path, SHIP)
    differences = [difference(found[i, j].T_target_source, poses[i].inv() * poses[j]) for i, j in found]
    angle, distance = np.max(differences, axis=0)
    print(f"{len(differences)} pairs, at most {angle:.2f} degrees and {100 * distance:.1f} cm from the mean chain")
    assert all(registration.accepted for registration in found.values())
    assert len(differences) == 15
    assert angle < 1
    assert distance < 0.03


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
