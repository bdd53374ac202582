// Whether points, moved by many poses, agree with what sensors saw: range images say how far each beam went.
//
// Layout: a way is from the points of one scan to the range images of another; there are two, or the second has no
// image. views (images, EDGE * EDGE) float2, the nearest and the farthest range of each cell, (INFINITY, -INFINITY)
// where no beam came back; points planar, 3 x count float32, from `valid` on padding; places (images) float4, where the
// sensors of the images were; poses (n, 16) float32, the rows of [R | t] in the first 12, which bring the second way's
// scan, whose points the first way moves, to the first way's: the second way is moved by the inverse; jobs are the images
// of the first way, then those of the second; out
// (jobs, n, TOLERANCES, 3) int32: how many points agree, contradict, and fall into cells that saw something. A cell is
// one of the octahedral map (Engelhardt and Dachsbacher 2008): the sphere unfolded to a square through an octahedron. A
// point agrees within `reach + slope * range` of the cell's ranges, and contradicts nearer than that: the beam went
// through. tolerances holds two of these, of which the second is needed where TOLERANCES is 2.
// Precondition: counts are multiples of 8.
#ifndef EDGE
#define EDGE 128
#endif
#ifndef TOLERANCES
#define TOLERANCES 1
#endif
#ifndef CPU
#define CPU 1
#endif

// Where the points and the range image of a job are.
#define WAY                                                                                      \
    const size_t pose = get_global_id(GET_POSE);                                                 \
    const int job = get_global_id(GET_POSE + 1);                                                 \
    const bool forth = job < images1;                                                            \
    const int count = forth ? count1 : count2;                                                   \
    const int valid = forth ? valid1 : valid2;                                                   \
    __global const float* const points = forth ? points1 : points2;                              \
    __global const float* const view =                                                           \
        forth ? views1 + 2 * job * EDGE * EDGE : views2 + 2 * (job - images1) * EDGE * EDGE;     \
    const size_t at = job * get_global_size(GET_POSE) + pose;                                    \
    const float16 T = poses[pose];                                                               \
    const float4 place = forth ? places1[job] : places2[job - images1];                          \
    const float4 turn0 = (float4)(forth ? T.s012 : T.s048, (forth ? T.s3 : -dot(T.s048, T.s37b)) - place.x); \
    const float4 turn1 = (float4)(forth ? T.s456 : T.s159, (forth ? T.s7 : -dot(T.s159, T.s37b)) - place.y); \
    const float4 turn2 = (float4)(forth ? T.s89a : T.s26a, (forth ? T.sb : -dot(T.s26a, T.s37b)) - place.z); \
    const float reaches[2] = {tolerances.x, tolerances.z};                                       \
    const float slopes[2] = {tolerances.y, tolerances.w};

#define ARGUMENTS                                                                                             \
    __global const float* const views1, __global const float4* const places1, __global const float* const views2, \
        __global const float4* const places2, __global const float* const points1,                            \
        __global const float* const points2, __global const float16* const restrict poses,                    \
        __global int* const restrict out, const int images1, const int count1, const int valid1,             \
        const int count2, const int valid2, const float4 tolerances

#if CPU
#define GET_POSE 0

static int8 octahedral_cell(const float8 x, const float8 y, const float8 z) {
    const float8 scale = 1.0f / fmax(fabs(x) + fabs(y) + fabs(z), 1e-20f);
    const float8 u = x * scale;
    const float8 v = y * scale;
    const float8 folded_u = (1.0f - fabs(v)) * select((float8)(1.0f), (float8)(-1.0f), u < 0.0f);
    const float8 folded_v = (1.0f - fabs(u)) * select((float8)(1.0f), (float8)(-1.0f), v < 0.0f);
    const float8 p = select(u, folded_u, z < 0.0f);
    const float8 q = select(v, folded_v, z < 0.0f);
    const int8 i = clamp(convert_int8((p + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    const int8 j = clamp(convert_int8((q + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    return i * EDGE + j;
}

static int sum8(const int8 v) {
    const int4 a = v.lo + v.hi;
    return a.x + a.y + a.z + a.w;
}

// One work-item: all points under one pose, for one image.
__kernel void agreement(ARGUMENTS) {
    WAY
    int8 seen = 0;
    int8 agreeing[TOLERANCES], contradicting[TOLERANCES];
    for (int k = 0; k < TOLERANCES; ++k) agreeing[k] = contradicting[k] = 0;
    for (int n = 0; n < count; n += 8) {
        const float8 px = vload8(0, points + n);
        const float8 py = vload8(0, points + count + n);
        const float8 pz = vload8(0, points + 2 * count + n);
        const float8 x = turn0.x * px + turn0.y * py + turn0.z * pz + turn0.w;
        const float8 y = turn1.x * px + turn1.y * py + turn1.z * pz + turn1.w;
        const float8 z = turn2.x * px + turn2.y * py + turn2.z * pz + turn2.w;
        const float8 range = sqrt(x * x + y * y + z * z);
        const int8 cell = octahedral_cell(x, y, z);
        const float16 ranges = (float16)(vload2(cell.s0, view), vload2(cell.s1, view), vload2(cell.s2, view),
                                         vload2(cell.s3, view), vload2(cell.s4, view), vload2(cell.s5, view),
                                         vload2(cell.s6, view), vload2(cell.s7, view));
        const float8 near = ranges.even;
        const float8 far = ranges.odd;
        const int8 hit = n + (int8)(0, 1, 2, 3, 4, 5, 6, 7) < valid && far >= 0.0f;
        // true is -1
        seen -= hit;
#pragma unroll
        for (int k = 0; k < TOLERANCES; ++k) {
            const float8 tolerance = reaches[k] + slopes[k] * range;
            contradicting[k] -= hit && range < near - tolerance;
            agreeing[k] -= hit && range >= near - tolerance && range <= far + tolerance;
        }
    }
    for (int k = 0; k < TOLERANCES; ++k)
        vstore3((int3)(sum8(agreeing[k]), sum8(contradicting[k]), sum8(seen)), at * TOLERANCES + k, out);
}
#else
#define GET_POSE 1
#define GROUP 64

static int octahedral_cell(const float x, const float y, const float z) {
    const float scale = 1.0f / fmax(fabs(x) + fabs(y) + fabs(z), 1e-20f);
    const float u = x * scale;
    const float v = y * scale;
    const float p = z < 0.0f ? (1.0f - fabs(v)) * (u < 0.0f ? -1.0f : 1.0f) : u;
    const float q = z < 0.0f ? (1.0f - fabs(u)) * (v < 0.0f ? -1.0f : 1.0f) : v;
    const int i = clamp((int)((p + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    const int j = clamp((int)((q + 1.0f) * (0.5f * EDGE)), 0, EDGE - 1);
    return i * EDGE + j;
}

// One work-group: all points under one pose, for one image.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void agreement(ARGUMENTS) {
    WAY
    __local int sums[1 + 2 * TOLERANCES][GROUP];
    const int item = get_local_id(0);
    int counts[1 + 2 * TOLERANCES];
    for (int k = 0; k < 1 + 2 * TOLERANCES; ++k) counts[k] = 0;
    for (int n = item; n < valid; n += GROUP) {
        const float px = points[n];
        const float py = points[count + n];
        const float pz = points[2 * count + n];
        const float x = turn0.x * px + turn0.y * py + turn0.z * pz + turn0.w;
        const float y = turn1.x * px + turn1.y * py + turn1.z * pz + turn1.w;
        const float z = turn2.x * px + turn2.y * py + turn2.z * pz + turn2.w;
        const float range = sqrt(x * x + y * y + z * z);
        const float2 ranges = vload2(octahedral_cell(x, y, z), view);
        if (!(ranges.y >= 0.0f)) continue;
        ++counts[0];
        for (int k = 0; k < TOLERANCES; ++k) {
            const float tolerance = reaches[k] + slopes[k] * range;
            const bool before = range < ranges.x - tolerance;
            counts[1 + 2 * k] += !before && range <= ranges.y + tolerance;
            counts[2 + 2 * k] += before;
        }
    }
    for (int k = 0; k < 1 + 2 * TOLERANCES; ++k) sums[k][item] = counts[k];
    for (int half_group = GROUP / 2; half_group > 0; half_group /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < half_group)
            for (int k = 0; k < 1 + 2 * TOLERANCES; ++k) sums[k][item] += sums[k][item + half_group];
    }
    if (item < TOLERANCES)
        vstore3((int3)(sums[1 + 2 * item][0], sums[2 + 2 * item][0], sums[0][0]), at * TOLERANCES + item, out);
}
#endif
