"""Files of poses: TUM and KITTI trajectories, g2o pose graphs."""
