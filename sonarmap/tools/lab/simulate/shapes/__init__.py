"""Triangle meshes and voxel structures: solids to build scenes from, distances to surfaces, noise on voxels."""
