// The nearest point of a surface to each of many points, under each of many poses.
//
// Layout: points, starts and box as in cells.cl; places (n) float4, of which x, y, z count; poses (k, 16) float32, the
// rows of [R | t] in the first 12; index (k, n) int32, -1 where nothing is within reach, and squared (k, n) float32.
// One work-item: a point under a pose.
#include "surface/cells.cl"

__kernel void nearest(__global const float4* const restrict points, __global const int* const restrict starts,
                      const float8 box, __global const float4* const restrict places,
                      __global const float16* const restrict poses, __global int* const restrict index,
                      __global float* const restrict squared, const int count, const float reach) {
    const int n = get_global_id(0);
    const size_t pose = get_global_id(1);
    if (n >= count) return;
    const float16 T = poses[pose];
    const float3 place = turned(T, places[n].xyz) + shift_of(T);
    const Kept kept = search(points, starts, box, place, reach * reach);
    index[pose * count + n] = kept.index < 0 ? -1 : as_int(points[kept.index].w);
    squared[pose * count + n] = kept.index < 0 ? INFINITY : kept.worst;
}
