// The magnitudes of images' half spectra, sampled in polar coordinates (Eq. 14 of the paper).
//
// Layout: spectrum (layers, n0, PITCH) complex64 as interleaved floats, not centered; PITCH complex numbers a row.
// points are samples x 2 float32, planar: the frequencies along axis 0 (negative ones too) and axis 1 [bins];
// out layers x samples float32. |F| is taken at the four corners, then interpolated; a real image has the same |F| at
// k and -k, so points with a negative second frequency are negated.
// Precondition: samples is a multiple of 8, frequencies lie inside (-n0/2, n0/2) and (-n1/2, n1/2).
#include "device/lanes.cl"

#define CORNERS(s)                                              \
    {                                                           \
        const float4 below = vload4(0, layer + 2 * low s);      \
        const float4 above = vload4(0, layer + 2 * high s);     \
        p00 s = below.x * below.x + below.y * below.y;          \
        p01 s = below.z * below.z + below.w * below.w;          \
        p10 s = above.x * above.x + above.y * above.y;          \
        p11 s = above.z * above.z + above.w * above.w;          \
    }

// One work-item: LANES adjacent samples of one layer.
__kernel void polar_magnitude(__global const float* const restrict spectrum,
                              __global const float* const restrict points, __global float* const restrict out,
                              const int layers, const int samples, const int n0, const int pitch) {
    const int n = LANES * get_global_id(0);
    const size_t l = get_global_id(1);
    if (n >= samples || l >= layers) return;
    __global const float* const layer = spectrum + 2 * l * n0 * pitch;
    const floatn v = loadn(points + samples + n);
    const floatn u = select(loadn(points + n), -loadn(points + n), v < 0.0f);
    const intn row = convert_intn_rtn(u);
    const intn column = convert_intn(fabs(v));
    const floatn fu = u - convert_floatn(row);
    const floatn fv = fabs(v) - convert_floatn(column);
    const intn next = row + 1;
    const intn low = select(row, row + n0, row < 0) * pitch + column;
    const intn high = select(next, next + n0, next < 0) * pitch + column;
    floatn p00, p01, p10, p11;
    EACH_LANE(CORNERS)
    const floatn m00 = sqrt(p00);
    const floatn m10 = sqrt(p10);
    const floatn m0 = fma(fv, sqrt(p01) - m00, m00);
    const floatn m1 = fma(fv, sqrt(p11) - m10, m10);
    storen(fma(fu, m1 - m0, m0), out + l * samples + n);
}
