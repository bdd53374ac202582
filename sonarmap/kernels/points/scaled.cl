// Points on a grid of other voxels.
//
// Layout: points and out (count) float4: x, y, z [voxels from the grid's center], weight, which stays. One work-item per
// point.
__kernel void scaled(__global const float4* const restrict points, __global float4* const restrict out, const int count,
                     const float factor) {
    const int n = get_global_id(0);
    if (n < count) out[n] = points[n] * (float4)(factor, factor, factor, 1.0f);
}
