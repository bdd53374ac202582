// Pairs of nearest points of two surfaces, both ways, under each of many poses; and how far apart they usually are.
//
// Layout: of both surfaces points, starts and box, and elements, as in cells.cl, and how many of these, every
// `step`-th, take part; records (k, RECORD) as in real.cl; rows (k, n) float16, n the source's points, then the target's:
// s012 the normal of the surface whose plane the source's point is to lie in, in the target's axes, s3 how far it stands
// off that plane, s456 the source's point from its grid's center in the target's axes, s7 0 for a pair beyond reach, 1
// for one at a rim or on two sides of a plate, else 2, s89a the other scan's surface there, turned to the side of the
// normal, sbc how the gap changes with the stretch of the source and of the target, sd the
// width of the weights' bell. Points may be so far apart: `tried`, or BELLS times that width where that is more.
#include "surface/cells.cl"
#include "surface/real.cl"
#ifndef LANES
#define LANES 1
#define BELL 0.1666667f
#define WIDE_BELL 0.8f
#define BELLS 4.0f
#endif

// One work-item: a point under a pose. Where `near` is 0 rims count as the others do.
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

// How many of a pose's pairs within reach have gaps of at most `bits`; how far the next gap is, if any.
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

// The gap that `rank` others are not above: bits of positive floats order as integers do.
static int ranked_gap(__global const float16* const restrict rows, const int count, const int rank, const int lane,
                      __local int* const sums) {
    int bits = 0;
    for (int bit = 30; bit >= 0; --bit) {
        const int tried = bits | ((1 << bit) - 1);
        if (count_gaps(rows, count, tried, lane, sums) <= rank) bits |= 1 << bit;
    }
    return bits;
}

// The median gap of each pose's pairs becomes its width; one group a pose. Where there is no pair it stays.
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
