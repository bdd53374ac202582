// The overlap of two surfaces under many poses: sums over points of each, by their nearest neighbors in the other.
//
// Layout: of both surfaces points, starts, box and elements as in cells.cl; `count` elements, every `step`-th, take
// part. weights (directions) float32 by the directions of the normals; poses (k, 16) float32, the rows of [R | t] in
// the first 12, p_target = R p_source + t; out (k, 2, parts, 4) float32: of the source's points, then of the target's,
// the total weight of those that agree, of those that are covered, of all, and the number of those that lie on the
// other surface.
// A point is covered if its nearest neighbor is within COVERED; it lies on the other surface if it is within REACH, and
// agrees if also the normals' cosine is at least ALIKE. One work-item: ITEM points; one group: LANES work-items.
#include "surface/cells.cl"
#ifndef ITEM
#define ITEM 64
#define LANES 1
#define REACH 2.0f
#define COVERED 6.0f
#define ALIKE 0.8f
#endif

__kernel void shared(__global const float4* const restrict target_points,
                     __global const int* const restrict target_starts, const float8 target_box,
                     __global const float4* const restrict target_elements,
                     __global const float* const restrict target_weights, const int target_count,
                     const int target_step, __global const float4* const restrict source_points,
                     __global const int* const restrict source_starts, const float8 source_box,
                     __global const float4* const restrict source_elements,
                     __global const float* const restrict source_weights, const int source_count,
                     const int source_step, __global const float16* const restrict poses,
                     __global float4* const restrict out) {
    __local float4 sums[LANES];
    const int lane = get_local_id(0);
    const size_t pose = get_global_id(1);
    const bool back = get_global_id(2);
    const float16 T = poses[pose];
    const int count = back ? target_count : source_count;
    const int step = back ? target_step : source_step;
    const int first = get_group_id(0) * ITEM * LANES + lane;
    float4 sum = (float4)(0.0f);
    for (int n = first; n < min(first + ITEM * LANES, count); n += LANES) {
        const Element own = element(back ? target_elements : source_elements, n * step);
        const float3 place = back ? turned_back(T, own.point.xyz - shift_of(T)) : turned(T, own.point.xyz) + shift_of(T);
        const Kept kept = search(back ? source_points : target_points, back ? source_starts : target_starts,
                                 back ? source_box : target_box, place, COVERED * COVERED);
        const float weight = (back ? target_weights : source_weights)[(int)own.normal.w];
        sum.z += weight;
        if (kept.index < 0) continue;
        sum.y += weight;
        if (kept.worst > REACH * REACH) continue;
        sum.w += 1.0f;
        const int there = as_int((back ? source_points : target_points)[kept.index].w);
        const float3 normal = (back ? source_elements : target_elements)[3 * there + 1].xyz;
        const float3 facing = back ? turned_back(T, own.normal.xyz) : turned(T, own.normal.xyz);
        sum.x += fabs(dot(facing, normal)) >= ALIKE ? weight : 0.0f;
    }
    sums[lane] = sum;
    for (int half_of = LANES / 2; half_of; half_of /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (lane < half_of) sums[lane] += sums[lane + half_of];
    }
    if (!lane) out[(2 * pose + back) * get_num_groups(0) + get_group_id(0)] = sums[0];
}

// The nearest point of a surface to each of n places under each of k poses: places (n) float4 without use of w; index
// (k, n) int32, -1 if no point is within reach, and squared (k, n) float32, the squared distance. One work-item: a
// place under a pose.
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
