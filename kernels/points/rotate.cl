// A volume rotated about its center, trilinear: out(x) = volume(R^T x), 0 where R^T x is outside.
//
// Layout: EDGE^3 float32 in C order; the center is index EDGE/2 on each axis. inverse holds the rows of R^T.
// Along a row of the result the position moves by a constant step, so the part of the row that lies inside is an
// interval: it is found first, and its loop tests no bounds.
// Precondition: out is not the volume.
#ifndef EDGE
#define EDGE 128
#endif
#define LAST ((float)(EDGE - 1))

// Whether element k of a line that starts at `start` and moves by `step` is on the grid.
static bool inside(const float3 start, const float3 step, const int k) {
    const float3 p = fma(step, (float3)(k), start);
    return p.x >= 0 && p.y >= 0 && p.z >= 0 && p.x <= LAST && p.y <= LAST && p.z <= LAST;
}

// Narrow [*first, *end) to the elements whose coordinate is within [0, EDGE - 1], to within one element too wide.
static void narrow(const float start, const float step, float* const first, float* const end) {
    if (fabs(step) < 1e-6f) {
        if (start < -1e-3f || start > LAST + 1e-3f) *end = 0.0f;
        return;
    }
    const float a = -start / step;
    const float b = (LAST - start) / step;
    *first = fmax(*first, floor(fmin(a, b)) - 1.0f);
    *end = fmin(*end, ceil(fmax(a, b)) + 2.0f);
}

// One work-item per row.
__kernel void rotate_volume(__global const float* const restrict volume, __global float* const restrict out,
                            const float16 inverse) {
    const int j = get_global_id(0);
    const int i = get_global_id(1);
    const float3 step = (float3)(inverse.s2, inverse.s6, inverse.sa);
    const float x = i - EDGE / 2;
    const float y = j - EDGE / 2;
    const float3 start = fma((float3)(inverse.s0, inverse.s4, inverse.s8), (float3)(x),
                             fma((float3)(inverse.s1, inverse.s5, inverse.s9), (float3)(y),
                                 fma(step, (float3)(-EDGE / 2), (float3)(EDGE / 2))));
    float from = 0.0f;
    float to = EDGE;
    narrow(start.x, step.x, &from, &to);
    narrow(start.y, step.y, &from, &to);
    narrow(start.z, step.z, &from, &to);
    int first = (int)fmin(from, (float)EDGE);
    int end = (int)fmax(to, (float)first);
    // rounding is monotonic, so what remains too wide is at the ends
    while (first < end && !inside(start, step, first)) ++first;
    while (end > first && !inside(start, step, end - 1)) --end;

    __global float* const row = out + (size_t)(i * EDGE + j) * EDGE;
    for (int k = 0; k < first; ++k) row[k] = 0.0f;
    for (int k = first; k < end; ++k) {
        const float px = fma(step.x, (float)k, start.x);
        const float py = fma(step.y, (float)k, start.y);
        const float pz = fma(step.z, (float)k, start.z);
        // the last index is the upper corner of the cell before it
        const int ix = min((int)px, EDGE - 2);
        const int iy = min((int)py, EDGE - 2);
        const int iz = min((int)pz, EDGE - 2);
        const float fx = px - ix;
        const float fy = py - iy;
        const float fz = pz - iz;
        __global const float* const at = volume + (ix * EDGE + iy) * EDGE + iz;
        const float v00 = fma(fz, at[1] - at[0], at[0]);
        const float v01 = fma(fz, at[EDGE + 1] - at[EDGE], at[EDGE]);
        const float v10 = fma(fz, at[EDGE * EDGE + 1] - at[EDGE * EDGE], at[EDGE * EDGE]);
        const float v11 = fma(fz, at[EDGE * EDGE + EDGE + 1] - at[EDGE * EDGE + EDGE], at[EDGE * EDGE + EDGE]);
        const float v0 = fma(fy, v01 - v00, v00);
        const float v1 = fma(fy, v11 - v10, v10);
        row[k] = fma(fx, v1 - v0, v0);
    }
    for (int k = end; k < EDGE; ++k) row[k] = 0.0f;
}
