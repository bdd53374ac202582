// The magnitudes of images' half spectra, sampled on polar coordinates (Eq. 14 of the paper).
//
// Layout: spectrum (layers, n0, PITCH) complex64 as interleaved floats, not centered; PITCH complex numbers a row.
// points are samples x 2 float32, planar: the frequencies along axis 0 (negative ones too) and axis 1 [bins];
// out layers x samples float32. |F| is taken at the four corners, then interpolated; a real image has it alike at k and
// -k, so that points with a negative second frequency are turned around.
// Precondition: samples is a multiple of 8, frequencies lie inside (-n0/2, n0/2) and (-n1/2, n1/2).

#define CORNERS(s)                                               \
    {                                                            \
        const float4 below = vload4(0, layer + 2 * low.s);       \
        const float4 above = vload4(0, layer + 2 * high.s);      \
        p00.s = below.x * below.x + below.y * below.y;           \
        p01.s = below.z * below.z + below.w * below.w;           \
        p10.s = above.x * above.x + above.y * above.y;           \
        p11.s = above.z * above.z + above.w * above.w;           \
    }

// One work-item: 8 adjacent samples of one layer.
__kernel void polar_magnitude(__global const float* const restrict spectrum,
                              __global const float* const restrict points, __global float* const restrict out,
                              const int samples, const int n0, const int pitch) {
    const int n = 8 * get_global_id(0);
    const size_t l = get_global_id(1);
    __global const float* const layer = spectrum + 2 * l * n0 * pitch;
    const float8 v = vload8(0, points + samples + n);
    const float8 u = select(vload8(0, points + n), -vload8(0, points + n), v < 0.0f);
    const int8 row = convert_int8_rtn(u);
    const int8 column = convert_int8(fabs(v));
    const float8 fu = u - convert_float8(row);
    const float8 fv = fabs(v) - convert_float8(column);
    const int8 next = row + 1;
    const int8 low = select(row, row + n0, row < 0) * pitch + column;
    const int8 high = select(next, next + n0, next < 0) * pitch + column;
    float8 p00, p01, p10, p11;
    CORNERS(s0) CORNERS(s1) CORNERS(s2) CORNERS(s3) CORNERS(s4) CORNERS(s5) CORNERS(s6) CORNERS(s7)
    const float8 m00 = sqrt(p00);
    const float8 m10 = sqrt(p10);
    const float8 m0 = fma(fv, sqrt(p01) - m00, m00);
    const float8 m1 = fma(fv, sqrt(p11) - m10, m10);
    vstore8(fma(fu, m1 - m0, m0), 0, out + l * samples + n);
}
