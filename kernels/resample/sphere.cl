// Samples of a magnitude spectrum along directions, at many radii.
//
// Layout: magnitude (EDGE, EDGE, EDGE/2 + 1) float32, centered in axes 0 and 1; directions planar, 3 x pixels
// float32; out layers x pixels float32. turn holds the rows of R: samples are at k = radius (R direction), trilinear.
// The magnitude of a real volume is the same at k and -k, so a direction with k_z < 0 is turned around; its sign does
// not depend on the radius, and no cell of the interpolation lies across k_z = 0.
// A direction of 0 gives 0.
// Precondition: pixels is a multiple of 8, every radius is in [0, EDGE/2 - 1), and so all 8 corners are inside.
#ifndef EDGE
#define EDGE 128
#endif
#define DEPTH (EDGE / 2 + 1)

#define CORNERS(s)                                                             \
    {                                                                          \
        __global const float* const at = magnitude + base.s;                   \
        v000.s = at[0];                                                        \
        v001.s = at[1];                                                        \
        v010.s = at[DEPTH];                                                    \
        v011.s = at[DEPTH + 1];                                                \
        v100.s = at[EDGE * DEPTH];                                             \
        v101.s = at[EDGE * DEPTH + 1];                                         \
        v110.s = at[EDGE * DEPTH + DEPTH];                                     \
        v111.s = at[EDGE * DEPTH + DEPTH + 1];                                 \
    }

// One work-item: 8 adjacent pixels, all layers.
__kernel void sample(__global const float* const restrict magnitude, __global const float* const restrict directions,
                     __global const float* const restrict radii, __global float* const restrict out,
                     const int layers, const int pixels, const float16 turn) {
    const int n = 8 * get_global_id(0);
    const float8 x = vload8(0, directions + n);
    const float8 y = vload8(0, directions + pixels + n);
    const float8 z = vload8(0, directions + 2 * pixels + n);
    const float8 turned_z = turn.s8 * x + turn.s9 * y + turn.sa * z;
    const float8 side = select((float8)(1.0f), (float8)(-1.0f), turned_z < 0.0f);
    const float8 dx = side * (turn.s0 * x + turn.s1 * y + turn.s2 * z);
    const float8 dy = side * (turn.s4 * x + turn.s5 * y + turn.s6 * z);
    const float8 dz = side * turned_z;
    const float8 seen = select((float8)(0.0f), (float8)(1.0f), x * x + y * y + z * z > 0.0f);
    for (int l = 0; l < layers; ++l) {
        const float8 px = fma(dx, (float8)(radii[l]), (float8)(EDGE / 2));
        const float8 py = fma(dy, (float8)(radii[l]), (float8)(EDGE / 2));
        const float8 pz = dz * radii[l];
        // rounding may lift the largest radius onto the last index
        const int8 ix = min(convert_int8(px), EDGE - 2);
        const int8 iy = min(convert_int8(py), EDGE - 2);
        const int8 iz = convert_int8(pz);
        const float8 fx = px - convert_float8(ix);
        const float8 fy = py - convert_float8(iy);
        const float8 fz = pz - convert_float8(iz);
        const int8 base = (ix * EDGE + iy) * DEPTH + iz;
        float8 v000, v001, v010, v011, v100, v101, v110, v111;
        CORNERS(s0) CORNERS(s1) CORNERS(s2) CORNERS(s3) CORNERS(s4) CORNERS(s5) CORNERS(s6) CORNERS(s7)
        const float8 v00 = fma(fz, v001 - v000, v000);
        const float8 v01 = fma(fz, v011 - v010, v010);
        const float8 v10 = fma(fz, v101 - v100, v100);
        const float8 v11 = fma(fz, v111 - v110, v110);
        const float8 v0 = fma(fy, v01 - v00, v00);
        const float8 v1 = fma(fy, v11 - v10, v10);
        vstore8(seen * fma(fx, v1 - v0, v0), 0, out + (size_t)l * pixels + n);
    }
}
