"""Which loops agree: pairs of loops that close a short cycle together, and the groups that such pairs form.

Loops between neighbors of the same two places agree where the chain between them, which is short and therefore sure,
shows it (pairwise consistency: Mangelson, Dominic, Eustice and Vasudevan, ICRA 2018, DOI 10.1109/ICRA.2018.8460217).
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.chains import Chains
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated

NEAR = 5  # poses along the chain within which two loops are compared at either end


def agreeing_groups(chains: Chains, loops: Sequence[Edge], bound: float) -> np.ndarray:
    """The number of each loop's group: (m,) int; a loop that agrees with no other is alone.

    Args:
        chains: of the poses, along edges that join neighbors.
        loops: m measurements.
        bound: largest error of a cycle [sigmas].
    """
    forward = [edge.i < edge.j for edge in loops]
    ends = np.array([(min(edge.i, edge.j), max(edge.i, edge.j)) for edge in loops]).reshape(-1, 2)
    near = KDTree(ends).query_pairs(NEAR, p=np.inf, output_type="ndarray")
    if not len(near):
        return np.arange(len(loops))
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in loops])
    covariances = np.stack([edge.registration.covariance for edge in loops])
    backward = np.flatnonzero(~np.array(forward))
    if len(backward):
        covariances[backward] = propagated(measured[backward], covariances[backward])
        matrices = measured.as_matrix()
        matrices[backward] = measured[backward].inv().as_matrix()
        measured = RigidTransform.from_matrix(matrices)
    near = near[np.lexsort(near.T[::-1])]
    a, b = near.T
    T = chains.T
    T_ia_ib = T[ends[a, 0]].inv() * T[ends[b, 0]]
    T_jb_ja = T[ends[b, 1]].inv() * T[ends[a, 1]]
    cycle = T_ia_ib * measured[b] * T_jb_ja
    error = (measured[a].inv() * cycle).as_exp_coords()
    part = chains.part[ends]
    connected = (part[a] == part[b]).all(axis=1)
    total = covariances[a] + propagated(T_jb_ja.inv(), covariances[b])
    i_a, j_a, i_b, j_b = ends[a[connected], 0], ends[a[connected], 1], ends[b[connected], 0], ends[b[connected], 1]
    chain_i = propagated(T[i_b].inv(), chains.between(i_a, i_b))
    chain_j = propagated(T[j_a].inv(), chains.between(j_b, j_a))
    total[connected] += chain_j + propagated((measured[b] * T_jb_ja).inv()[connected], chain_i)
    in_agreement = connected & (lengths(error, total) <= bound)
    links = sparse.coo_array(
        (np.ones(int(in_agreement.sum())), (a[in_agreement], b[in_agreement])), shape=(len(loops), len(loops))
    )
    return connected_components(links, directed=False)[1]


def distances_from_chain(chains: Chains, loops: Sequence[Edge]) -> np.ndarray:
    """(m,) how far each loop is from what the chain alone says [sigmas]; 0 where the chain does not join its ends."""
    if not loops:
        return np.zeros(0)
    i, j = np.array([(edge.i, edge.j) for edge in loops]).T
    measured = RigidTransform.concatenate([edge.registration.T_target_source for edge in loops])
    error: np.ndarray = ((chains.T[i].inv() * chains.T[j]).inv() * measured).as_exp_coords()
    total = np.stack([edge.registration.covariance for edge in loops])
    joined = chains.part[i] == chains.part[j]
    total[joined] += propagated(chains.T[j[joined]].inv(), chains.between(i[joined], j[joined]))
    return np.where(joined, lengths(error, total), 0.0)
