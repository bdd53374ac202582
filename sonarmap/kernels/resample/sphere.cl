// Samples of a magnitude spectrum along directions, at many radii.
//
// Layout: magnitude (EDGE, EDGE, EDGE/2 + 1) float32, centered in axes 0 and 1; directions planar, 3 x pixels
// float32; out layers x pixels float32. turn holds the rows of R: samples are at k = radius (R direction), trilinear.
// The magnitude of a real volume is the same at k and -k, so a direction with k_z < 0 is negated; its sign does
// not depend on the radius, and no cell of the interpolation lies across k_z = 0.
// A direction of 0 gives 0.
// Precondition: pixels is a multiple of 8, every radius is in [0, EDGE/2 - 1), and so all 8 corners are inside.
#include "device/lanes.cl"
#ifndef EDGE
#define EDGE 128
#endif
#define DEPTH (EDGE / 2 + 1)

#define CORNERS(s)                                                             \
    {                                                                          \
        __global const float* const at = magnitude + base s;                   \
        v000 s = at[0];                                                        \
        v001 s = at[1];                                                        \
        v010 s = at[DEPTH];                                                    \
        v011 s = at[DEPTH + 1];                                                \
        v100 s = at[EDGE * DEPTH];                                             \
        v101 s = at[EDGE * DEPTH + 1];                                         \
        v110 s = at[EDGE * DEPTH + DEPTH];                                     \
        v111 s = at[EDGE * DEPTH + DEPTH + 1];                                 \
    }

// One work-item: LANES adjacent pixels, of all layers on a CPU, of one layer on a GPU.
__kernel void sample(__global const float* const restrict magnitude, __global const float* const restrict directions,
                     __global const float* const restrict radii, __global float* const restrict out,
                     const int layers, const int pixels, const float16 turn) {
    const int n = LANES * get_global_id(0);
    if (n >= pixels) return;
    const floatn x = loadn(directions + n);
    const floatn y = loadn(directions + pixels + n);
    const floatn z = loadn(directions + 2 * pixels + n);
    const floatn turned_z = turn.s8 * x + turn.s9 * y + turn.sa * z;
    const floatn side = select((floatn)(1.0f), (floatn)(-1.0f), turned_z < 0.0f);
    const floatn dx = side * (turn.s0 * x + turn.s1 * y + turn.s2 * z);
    const floatn dy = side * (turn.s4 * x + turn.s5 * y + turn.s6 * z);
    const floatn dz = side * turned_z;
    const floatn seen = select((floatn)(0.0f), (floatn)(1.0f), x * x + y * y + z * z > 0.0f);
    for (int l = get_global_id(1); l < layers; l += get_global_size(1)) {
        const floatn px = fma(dx, (floatn)(radii[l]), (floatn)(EDGE / 2));
        const floatn py = fma(dy, (floatn)(radii[l]), (floatn)(EDGE / 2));
        const floatn pz = dz * radii[l];
        // rounding may lift the largest radius onto the last index
        const intn ix = min(convert_intn(px), EDGE - 2);
        const intn iy = min(convert_intn(py), EDGE - 2);
        const intn iz = convert_intn(pz);
        const floatn fx = px - convert_floatn(ix);
        const floatn fy = py - convert_floatn(iy);
        const floatn fz = pz - convert_floatn(iz);
        const intn base = (ix * EDGE + iy) * DEPTH + iz;
        floatn v000, v001, v010, v011, v100, v101, v110, v111;
        EACH_LANE(CORNERS)
        const floatn v00 = fma(fz, v001 - v000, v000);
        const floatn v01 = fma(fz, v011 - v010, v010);
        const floatn v10 = fma(fz, v101 - v100, v100);
        const floatn v11 = fma(fz, v111 - v110, v110);
        const floatn v0 = fma(fy, v01 - v00, v00);
        const floatn v1 = fma(fy, v11 - v10, v10);
        storen(seen * fma(fx, v1 - v0, v0), out + (size_t)l * pixels + n);
    }
}
