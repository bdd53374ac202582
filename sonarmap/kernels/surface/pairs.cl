// Pairs of nearest points of two surfaces, from each to the other, under many poses; and the median gap of the pairs.
//
// Layout: of both surfaces points, starts, box and elements as in cells.cl; `count` elements, every `step`-th, take
// part. records (k, RECORD) as in real.cl; rows (k, n) float16, n the source's points, then the target's: s012 the
// plane's normal in the target's axes, s3 the gap: how far the source's point lies off that plane, s456 the source's
// point from its grid's center in the target's axes, s7 0 for a pair beyond reach, 1 for a pair at a rim or on two
// sides of a plate, else 2, s89a the other surface's normal, turned to the same side, sbc the gap's derivatives by the
// stretch of the source and of the target, sd the width of the weights' bell. The reach is `tried`, or BELLS times that
// width if that is more.
#include "surface/cells.cl"
#include "surface/real.cl"
#ifndef LANES
#define LANES 1
#define BELL 0.1666667f
#define WIDE_BELL 0.8f
#define BELLS 4.0f
#endif

// One work-item: a point under a pose. If `near` is 0, rims count like other points.
__kernel void pairs(__global const float4* const restrict target_points,
                    __global const int* const restrict target_starts, const float8 target_box,
                    __global const float4* const restrict target_elements, const int target_count,
                    const int target_step, __global const float4* const restrict source_points,
                    __global const int* const restrict source_starts, const float8 source_box,
                    __global const float4* const restrict source_elements, const int source_count,
                    const int source_step, __global const real* const restrict records,
                    __global float16* const restrict rows, const float tried, const int near) {
    const int n = get_global_id(0);
    const size_t pose = get_global_id(1);
    if (n >= source_count + target_count) return;
    __global const real* const record = records + pose * RECORD;
    const float16 T = pose_of(record);
    const float bell = fmax(tried * BELL, (float)record[WIDTH] * WIDE_BELL);
    const float reach = fmax(tried, BELLS * bell);
    const bool back = n >= source_count;
    const Element own = back ? element(target_elements, (n - source_count) * target_step)
                             : element(source_elements, n * source_step);
    const float3 place = back ? turned_back(T, own.point.xyz - shift_of(T)) : turned(T, own.point.xyz) + shift_of(T);
    __global const float4* const points = back ? source_points : target_points;
    const Kept kept = search(points, back ? source_starts : target_starts, back ? source_box : target_box, place,
                             reach * reach);
    __global float16* const row = rows + pose * (source_count + target_count) + n;
    if (kept.index < 0) {
        *row = (float16)(0.0f);
        return;
    }
    const Element other = element(back ? source_elements : target_elements, as_int(points[kept.index].w));
    const Element source = back ? other : own;
    const Element target = back ? own : other;
    const float3 arm = turned(T, source.point.xyz);
    const float3 source_normal = turned(T, source.normal.xyz);
    const float3 normal = back ? source_normal : target.normal.xyz;
    const float3 facing = back ? target.normal.xyz : source_normal;
    const float source_ray = dot(turned(T, source.ray.xyz), normal);
    const float target_ray = dot(target.ray.xyz, normal);
    // the two sides of a plate are not the same surface
    const bool moves = !near || (other.point.w > 0.0f && source_ray * target_ray >= 0.0f);
    *row = (float16)(normal, dot(arm + shift_of(T) - target.point.xyz, normal), arm, 1.0f + moves,
                     facing * sign(dot(normal, facing)), source_ray, -target_ray, bell, 0.0f, 0.0f);
}

// Number of a pose's pairs within reach whose gap, as the bits of a float, is at most `bits`.
static int count_gaps(__global const float16* const restrict rows, const int count, const int bits, const int lane,
                      __local int* const sums) {
    int sum = 0;
    for (int n = lane; n < count; n += LANES) sum += rows[n].s7 > 0.0f && as_int(fabs(rows[n].s3)) <= bits;
    barrier(CLK_LOCAL_MEM_FENCE);
    sums[lane] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    int total = 0;
    for (int n = 0; n < LANES; ++n) total += sums[n];
    return total;
}

// The gap of this rank, from 0, bit by bit: bits of positive floats order as integers do.
static int ranked_gap(__global const float16* const restrict rows, const int count, const int rank, const int lane,
                      __local int* const sums) {
    int bits = 0;
    for (int bit = 30; bit >= 0; --bit) {
        const int tried = bits | ((1 << bit) - 1);
        if (count_gaps(rows, count, tried, lane, sums) <= rank) bits |= 1 << bit;
    }
    return bits;
}

// Set each pose's width to the median gap of its pairs; without pairs it stays. One group: a pose.
__kernel void widths(__global const float16* const restrict rows, __global real* const restrict records,
                     const int count) {
    __local int sums[LANES];
    const int lane = get_local_id(0);
    const size_t pose = get_global_id(1);
    __global const float16* const own = rows + pose * count;
    const int near = count_gaps(own, count, as_int(INFINITY), lane, sums);
    if (!near) return;
    const float low = as_float(ranked_gap(own, count, (near - 1) / 2, lane, sums));
    const float high = near % 2 ? low : as_float(ranked_gap(own, count, near / 2, lane, sums));
    if (!lane) records[pose * RECORD + WIDTH] = ((real)low + (real)high) / 2;
}
