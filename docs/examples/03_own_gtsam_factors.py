"""A pose graph with a GTSAM factor of one's own: an acoustic fix of the last pose."""

import gtsam
import numpy as np
from scipy.spatial.transform import RigidTransform

import sonarmap

# Five poses in a row, 10 m apart; every registration is 2 % too short and sure to 5 cm and 0.1 degrees.
step = RigidTransform.from_translation([9.8, 0, 0])
covariance = np.diag(np.repeat([np.deg2rad(0.1), 0.05], 3) ** 2)
measured = sonarmap.Registration(step, covariance, psr=50.0, overlap=0.7, accepted=True, seconds=0.0)
edges = tuple(sonarmap.Edge(k, k + 1, measured, "sequential") for k in range(4))
chained = RigidTransform.from_translation(np.outer(9.8 * np.arange(5), [1, 0, 0]))
graph = sonarmap.PoseGraph(sonarmap.Trajectory(np.arange(5.0), chained), edges)

# The graph's own factors, and one more: the last pose is at (40, 0.5, 0) m, known to 10 cm.
factors = sonarmap.factors_of(graph)
factors.add(gtsam.GPSFactor(4, np.array([40.0, 0.5, 0.0]), gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
initial = sonarmap.to_values(graph.trajectory.T_world_sensor)
optimum = gtsam.LevenbergMarquardtOptimizer(factors, initial).optimize()

before = graph.optimize().trajectory.T_world_sensor.translation[-1]
after = sonarmap.to_transforms(optimum, 5).translation[-1]
print(f"last position without the fix {before.round(2)}, with it {after.round(2)}")
