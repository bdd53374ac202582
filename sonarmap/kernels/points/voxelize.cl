// Voxelize: every voxel takes the largest weight of the points that fall into it.
//
// Layout: points are COUNT float4 (x, y, z [voxels from the grid's center], weight); the volume is edge^3
// float32 in C order, axis 0 is x. pose holds the rows of [R | offset + edge/2 + 0.5] (see launch.affine).
// Precondition: the volume is zero. Weights that are not above zero, and points outside, are dropped: the bits of
// positive floats order as integers do, so that the result does not depend on the order of the points.

static void put(const float4 p, const float16 pose, const int edge, __global int* const volume,
                __global int* const marks) {
    const float x = fma(pose.s0, p.x, fma(pose.s1, p.y, fma(pose.s2, p.z, pose.s3)));
    const float y = fma(pose.s4, p.x, fma(pose.s5, p.y, fma(pose.s6, p.z, pose.s7)));
    const float z = fma(pose.s8, p.x, fma(pose.s9, p.y, fma(pose.sa, p.z, pose.sb)));
    const bool inside = x >= 0 && y >= 0 && z >= 0 && x < edge && y < edge && z < edge;  // false for NaN
    if (!inside || !(p.w > 0)) return;
    const int row = (int)x * edge + (int)y;
    __global int* const voxel = volume + row * edge + (int)z;
    // most points find their voxel filled: a read costs far less than the atomic, and old values are never too high
    if (*voxel < as_int(p.w)) atomic_max(voxel, as_int(p.w));
    if (marks && !marks[row / 8]) marks[row / 8] = 1;
}

__kernel void voxelize(__global const float4* const restrict points, __global int* const restrict volume,
                       const int count, const int edge, const float16 pose) {
    const int n = get_global_id(0);
    if (n < count) put(points[n], pose, edge, volume, 0);
}

// One volume per pose. A pose is 20 floats, the first 16 as above; pose `first` is that of volume 0. marks are
// edge^2 / 8 ints, rounded up, for each volume: one is set to 1 if any of its 8 rows holds a point.
__kernel void voxelize_poses(__global const float4* const restrict points, __global int* const restrict volumes,
                             __global int* const restrict marks, __global const float* const restrict poses,
                             const int count, const int edge, const int first) {
    const int n = get_global_id(0);
    const size_t number = get_global_id(1);
    const float16 pose = vload16(0, poses + 20 * (first + number));
    if (n < count)
        put(points[n], pose, edge, volumes + number * edge * edge * edge, marks + number * ((edge * edge + 7) / 8));
}

// Points scaled to a grid of voxels of another size; weights stay.
__kernel void scaled(__global const float4* const restrict points, __global float4* const restrict out, const int count,
                     const float factor) {
    const int n = get_global_id(0);
    if (n < count) out[n] = points[n] * (float4)(factor, factor, factor, 1.0f);
}
