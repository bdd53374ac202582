"""The pairs of the paper's Table 1: its reference scan with each of S0..S9, ever farther away and more rotated."""

from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_RIG, table1, table1_transform
from sonarmap.tools.lab.simulate.plan import table1_settings
from sonarmap.tools.lab.simulate.simulation import observe


def table1_pair(index: int, seed: int, sigma2: float, scene: str = "floodgate") -> tuple[Scan, Scan, RigidTransform]:
    """The reference scan and S`index`, with the noise of the paper's Sect. 3, and the truth between them.

    Args:
        index: 0..9, the row of Table 1; 10..12 continue it.
        seed: of the scene and of the noise; the reference scan is the same for every index.
        sigma2: variance of the range noise at the sensor's maximum range [m^2] (the paper: 1 and 2 voxels).
        scene: a key of SCENE_KINDS.

    Returns:
        target Scan (the reference), source Scan (S`index`), both in their own sensor frames (level with the
        grid, at TABLE1_RIG in it), and T_target_source between these. About the grid's center, the point
        -TABLE1_RIG of either sensor frame, it is table1_transform(index).
    """
    settings = table1_settings(seed, sigma2, scene)
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    T_target_source = T_grid_rig.inv() * table1_transform(index) * T_grid_rig
    poses = table1(index + 1).T_world_sensor
    target = observe(settings, poses[0], 0, "Sr")
    source = observe(settings, poses[index + 1], index + 1, f"S{index}")
    return target, source, T_target_source
