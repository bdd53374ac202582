// Count the points, moved by many poses, that agree with range images, and those that a beam passed through.
//
// Layout: points of one scan and range images of another, and the reverse; either may have no image. views (images,
// EDGE * EDGE) float2, the nearest and the farthest range of each cell, (INFINITY, -INFINITY) without a range; points
// planar, 3 x count float32, from `valid` on padding; places (images) float4, the sensor positions of the images; poses
// (n, 16) float32, the rows of [R | t] in the first 12, which move the first points to the frame of their images, and
// their inverses the second points; jobs are the first images, then the second; out (jobs, n, wanted, 3) int32:
// numbers of points that agree, that contradict, and that fall into cells with a range. The cells are those of the
// octahedral map (Engelhardt and Dachsbacher 2008): the sphere unfolded to a square through an octahedron. A point
// agrees within `reach + slope * range` of the cell's ranges, and contradicts if it is nearer: the beam passed through
// it. tolerances holds two of (reach, slope); the second is used if `wanted` is 2.
// Precondition: counts are multiples of 8.
#include "device/lanes.cl"
#ifndef EDGE
#define EDGE 128
#endif
#define TOLERANCES 2
#define COUNTS (1 + 2 * TOLERANCES)

#ifdef GPU
#define GROUP 64
#define counted(condition) (condition)
#define LANE_NUMBERS 0
#else
#define GROUP 1
#define counted(condition) (-(condition))  // true is -1
#define LANE_NUMBERS (int8)(0, 1, 2, 3, 4, 5, 6, 7)

static int sum8(const int8 v) {
    const int4 a = v.lo + v.hi;
    return a.x + a.y + a.z + a.w;
}
#endif

#define RANGES(s)                                      \
    {                                                  \
        const float2 ranges = vload2(cell s, view);    \
        near s = ranges.x;                             \
        far s = ranges.y;                              \
    }

static intn octahedral_cell(const floatn x, const floatn y, const floatn z) {
    const floatn scale = 1.0f / fmax(fabs(x) + fabs(y) + fabs(z), 1e-20f);
    const floatn u = x * scale;
    const floatn v = y * scale;
    const floatn folded_u = (1.0f - fabs(v)) * select((floatn)(1.0f), (floatn)(-1.0f), u < 0.0f);
    const floatn folded_v = (1.0f - fabs(u)) * select((floatn)(1.0f), (floatn)(-1.0f), v < 0.0f);
    const floatn p = select(u, folded_u, z < 0.0f);
    const floatn q = select(v, folded_v, z < 0.0f);
    const intn i = clamp(convert_intn((p + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    const intn j = clamp(convert_intn((q + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    return i * EDGE + j;
}

// One group: all points under one pose, for one image.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void agreement(
    __global const float* const views1, __global const float4* const places1, __global const float* const views2,
    __global const float4* const places2, __global const float* const points1, __global const float* const points2,
    __global const float16* const restrict poses, __global int* const restrict out, const int images1, const int count1,
    const int valid1, const int count2, const int valid2, const int wanted, const float4 tolerances) {
    const size_t pose = get_global_id(1);
    const int job = get_global_id(2);
    const bool forth = job < images1;
    const int count = forth ? count1 : count2;
    const int valid = forth ? valid1 : valid2;
    __global const float* const points = forth ? points1 : points2;
    __global const float* const view =
        forth ? views1 + 2 * job * EDGE * EDGE : views2 + 2 * (job - images1) * EDGE * EDGE;
    const float16 T = poses[pose];
    const float4 place = forth ? places1[job] : places2[job - images1];
    const float4 turn0 = (float4)(forth ? T.s012 : T.s048, (forth ? T.s3 : -dot(T.s048, T.s37b)) - place.x);
    const float4 turn1 = (float4)(forth ? T.s456 : T.s159, (forth ? T.s7 : -dot(T.s159, T.s37b)) - place.y);
    const float4 turn2 = (float4)(forth ? T.s89a : T.s26a, (forth ? T.sb : -dot(T.s26a, T.s37b)) - place.z);
    const float reaches[2] = {tolerances.x, tolerances.z};
    const float slopes[2] = {tolerances.y, tolerances.w};
    intn counts[COUNTS];  // in cells with a range; then for each tolerance those that agree, those that contradict
    for (int k = 0; k < COUNTS; ++k) counts[k] = 0;
    for (SHARED(n, count)) {
        const floatn px = loadn(points + n), py = loadn(points + count + n), pz = loadn(points + 2 * count + n);
        const floatn x = turn0.x * px + turn0.y * py + turn0.z * pz + turn0.w;
        const floatn y = turn1.x * px + turn1.y * py + turn1.z * pz + turn1.w;
        const floatn z = turn2.x * px + turn2.y * py + turn2.z * pz + turn2.w;
        const floatn range = sqrt(x * x + y * y + z * z);
        const intn cell = octahedral_cell(x, y, z);
        floatn near, far;
        EACH_LANE(RANGES)
        const intn hit = n + LANE_NUMBERS < valid && far >= 0.0f;
        counts[0] += counted(hit);
#pragma unroll
        for (int k = 0; k < TOLERANCES; ++k) {
            if (k >= wanted) continue;
            const floatn tolerance = reaches[k] + slopes[k] * range;
            counts[1 + 2 * k] += counted(hit && range >= near - tolerance && range <= far + tolerance);
            counts[2 + 2 * k] += counted(hit && range < near - tolerance);
        }
    }
    const size_t at = (job * get_global_size(1) + pose) * wanted;
#ifdef GPU
    __local int sums[COUNTS][GROUP];
    const int item = get_local_id(0);
    for (int k = 0; k < COUNTS; ++k) sums[k][item] = counts[k];
    for (int half_group = GROUP / 2; half_group > 0; half_group /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < half_group)
            for (int k = 0; k < COUNTS; ++k) sums[k][item] += sums[k][item + half_group];
    }
    if (item < wanted)
        vstore3((int3)(sums[1 + 2 * item][0], sums[2 + 2 * item][0], sums[0][0]), at + item, out);
#else
    for (int k = 0; k < wanted; ++k)
        vstore3((int3)(sum8(counts[1 + 2 * k]), sum8(counts[2 + 2 * k]), sum8(counts[0])), at + k, out);
#endif
}
