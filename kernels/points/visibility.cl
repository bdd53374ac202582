// Whether points, moved by many poses, agree with what a sensor saw: its range image says how far each beam went.
//
// Layout: view (EDGE * EDGE) float2, the nearest and the farthest range of each cell, (INFINITY, -INFINITY) where no
// beam came back; points planar, 3 x count float32; poses (n, 16) float32, the rows of [R | t] in the first 12; out
// (n, parts, 3) int32: how many points agree, contradict, and fall into cells that saw something. Points from `valid`
// on are padding. A cell is one of the octahedral map (Engelhardt and Dachsbacher 2008): the sphere unfolded to a
// square through an octahedron. A point agrees within `reach + slope * range` of the cell's ranges, and contradicts
// nearer than that: the beam went through.
// Precondition: count and PART are multiples of 8.
#ifndef EDGE
#define EDGE 128
#endif
#ifndef PART
#define PART 256
#endif

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

// One work-item: PART points under one pose.
__kernel void agreement(__global const float* const restrict view, __global const float* const restrict points,
                        __global const float* const restrict poses, __global int* const restrict out, const int count,
                        const int valid, const float reach, const float slope) {
    const int part = get_global_id(0);
    const size_t pose = get_global_id(1);
    const float16 turn = vload16(0, poses + 16 * pose);
    int8 agreeing = 0;
    int8 contradicting = 0;
    int8 seen = 0;
    for (int n = part * PART; n < min((part + 1) * PART, count); n += 8) {
        const float8 px = vload8(0, points + n);
        const float8 py = vload8(0, points + count + n);
        const float8 pz = vload8(0, points + 2 * count + n);
        const float8 x = turn.s0 * px + turn.s1 * py + turn.s2 * pz + turn.s3;
        const float8 y = turn.s4 * px + turn.s5 * py + turn.s6 * pz + turn.s7;
        const float8 z = turn.s8 * px + turn.s9 * py + turn.sa * pz + turn.sb;
        const float8 range = sqrt(x * x + y * y + z * z);
        const int8 cell = octahedral_cell(x, y, z);
        const float16 ranges = (float16)(vload2(cell.s0, view), vload2(cell.s1, view), vload2(cell.s2, view),
                                         vload2(cell.s3, view), vload2(cell.s4, view), vload2(cell.s5, view),
                                         vload2(cell.s6, view), vload2(cell.s7, view));
        const float8 near = ranges.even;
        const float8 far = ranges.odd;
        const float8 tolerance = reach + slope * range;
        const int8 real = n + (int8)(0, 1, 2, 3, 4, 5, 6, 7) < valid;
        const int8 hit = real && far >= 0.0f;
        // true is -1
        seen -= hit;
        contradicting -= hit && range < near - tolerance;
        agreeing -= hit && range >= near - tolerance && range <= far + tolerance;
    }
    vstore3((int3)(sum8(agreeing), sum8(contradicting), sum8(seen)), pose * get_global_size(0) + part, out);
}
