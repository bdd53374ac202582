"""A method of registration of one's own in the mapper: ICP from the identity, with SciPy."""

import sys
from time import perf_counter

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

import sonarmap


class PointToPoint:
    """Any object with these two methods is a method of registration."""

    def prepare(self, scan: sonarmap.Scan) -> np.ndarray:
        """What a scan contributes to every pair of it; here every tenth point."""
        return scan.points[::10].astype(float)

    def register(self, target: np.ndarray, source: np.ndarray) -> sonarmap.Registration:
        """T_target_source from the identity, by 40 steps of point-to-point ICP."""
        start, T_target_source, tree, overlap = perf_counter(), RigidTransform.identity(), KDTree(target), 0.0
        for reach in np.geomspace(8.0, 1.5, 40):
            distance, index = tree.query(T_target_source.apply(source), distance_upper_bound=reach)
            near = np.isfinite(distance)
            a, b = target[np.asarray(index)[near]], source[near]
            R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0]
            T_target_source = RigidTransform.from_components(a.mean(axis=0) - R.apply(b.mean(axis=0)), R)
            overlap = float(near.mean())
        return sonarmap.Registration(
            T_target_source=T_target_source,
            covariance=np.diag(np.repeat([0.02, 0.3], 3) ** 2),
            psr=float("nan"),
            overlap=overlap,
            accepted=overlap > 0.4,
            seconds=perf_counter() - start,
            reason=f"{overlap:.0%} of the points have a counterpart",
        )


result = sonarmap.map_scans(sys.argv[1], method=PointToPoint(), voxel=1.0)
print(f"{sum(pair.kept for pair in result.pairs)} of {len(result.pairs)} pairs kept, {len(result.maps)} map(s)")
