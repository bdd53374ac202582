"""Fuse scans again, with changed poses: python 07_fuse_again.py SCANS"""

import sys

import numpy as np

import sonarmap

scans = sonarmap.read_scans(sys.argv[1])
result = sonarmap.map_scans(scans, edge=64)

again = sonarmap.fuse(scans, result.trajectory, result.voxel, covariances=result.covariances)
print(again)
assert np.allclose(again.points, result.maps[0].points), "the same poses give the same map"

poses = result.trajectory.T_world_sensor.as_matrix()
poses[-1, :3, 3] += [0.0, 0.0, 0.5]  # the last scan half a meter higher
changed = sonarmap.fuse(scans, poses, result.voxel, covariances=result.covariances)
print(f"{len(changed.points)} points, where there were {len(again.points)}")
