"""Table 1 of the paper as scans: moved and turned as it says, ever less in common."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_RIG, table1, table1_transform
from sonarmap.tools.lab.simulate.plan import TABLE1_SENSOR, table1_pair, table1_settings
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import overlap
from sonarmap.tools.lab.simulate.sensing.sensors import cast
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from sonarmap.tools.lab.simulate.simulation import simulate

FEW = replace(TABLE1_SENSOR, columns=64, rows=48)


def test_table_1_moves_and_turns_as_the_paper_says():
    """S8: 108, 72 and 36 voxels, yaw 54, roll 18, pitch 9 degrees, R = Rz Ry Rx written out."""
    transform = table1_transform(8)
    assert_allclose(transform.translation, (36, 72, 108))
    (cy, cp, cr), (sy, sp, sr) = (f(np.deg2rad((54, 9, 18))) for f in (np.cos, np.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    assert_allclose(transform.rotation.as_matrix(), about_z @ about_y @ about_x, atol=1e-12)
    assert_allclose(table1_transform(0).translation, (4, 8, 12))
    for index in (-1, 13):
        with pytest.raises(InputError, match="S0 to S9"):
            table1_transform(index)


def test_table_1_goes_on_with_the_same_steps_to_s12():
    transform = table1_transform(12)
    assert_allclose(transform.translation, (52, 104, 156))
    assert_allclose(transform.rotation.as_euler("ZYX", degrees=True), (78, 13, 26), atol=1e-9)
    assert len(table1()) == 11
    assert len(table1(13)) == 14
    assert_array_equal(table1(13).T_world_sensor[:11].as_matrix(), table1().T_world_sensor.as_matrix())
    target, source, T_target_source = table1_pair(12, seed=5, sigma2=0.0)
    assert 0.02 < overlap(target.points, source.points, T_target_source) < 0.2
    assert overlap(target.points, source.points, table1_pair(11, 5, 0.0)[2]) < 0.02


LARGE = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


@pytest.mark.slow
@pytest.mark.parametrize("scene", LARGE)
def test_the_rig_of_table_1_is_out_of_every_solid_of_forty_seeds(scene: str):
    places = table1(13).T_world_sensor.translation
    for seed in range(1, 41):
        assert not build_scene(scene, seed).is_solid(places).any()


@pytest.mark.parametrize("scene", LARGE)
@pytest.mark.parametrize("seed", range(1, 41, 13))
@pytest.mark.slow
def test_the_rig_of_table_1_is_free_in_every_large_scene(scene: str, seed: int):
    """Nothing within 3 m of any of its places; and the bed is in sight of each."""
    world, poses = build_scene(scene, seed), table1(13).T_world_sensor
    assert not world.is_solid(poses.translation).any()
    assert surface_distance(world.mesh, poses.translation).min() > 3.0
    for pose in poses:
        assert np.isfinite(cast(world, FEW, pose).ranges).mean() > 0.15


def test_table_1_pairs_obey_their_truth():
    """Without noise most of S1's points lie near the reference's; turned the wrong way they do not."""
    target, source, T_target_source = table1_pair(1, seed=5, sigma2=0.0)
    assert overlap(target.points, source.points, T_target_source) > 0.8
    assert overlap(target.points, source.points, T_target_source.inv()) < 0.5
    center = -np.array(TABLE1_RIG)
    about_center = RigidTransform.from_translation(-center) * T_target_source * RigidTransform.from_translation(center)
    assert_allclose(about_center.as_matrix(), table1_transform(1).as_matrix(), atol=1e-12)
    assert_allclose(T_target_source.rotation.as_euler("ZYX", degrees=True), (12, 2, 4), atol=1e-9)


def test_table_1_overlap_falls_smoothly_to_a_small_share():
    shares = []
    for index in range(10):
        target, source, T_target_source = table1_pair(index, seed=0, sigma2=0.0)
        shares.append(overlap(target.points, source.points, T_target_source))
    steps = -np.diff(shares)
    assert shares[0] > 0.85
    assert 0.15 <= shares[8] <= 0.35
    assert shares[9] > 0.1
    assert (steps > 0.03).all()
    assert (steps < 0.13).all()


def test_the_series_and_the_pair_are_the_same_scans():
    series = simulate(replace(table1_settings(seed=2, sigma2=1.0), count=4))
    target, source, T_target_source = table1_pair(2, seed=2, sigma2=1.0)
    assert_array_equal(series.scans[0].points, target.points)
    assert_array_equal(series.scans[3].points, source.points)
    poses = series.truth.T_world_sensor
    assert_allclose((poses[0].inv() * poses[3]).as_matrix(), T_target_source.as_matrix(), atol=1e-12)
