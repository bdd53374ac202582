// The values of a correlation near one shift, from its spectrum without a transform: sums with separable phases.
//
// Layout: spectra are (n0, n1, pitch) complex64, half spectra of real volumes; roots (n) are exp(2 pi i k / n), k < n.
// sums (6, n1, pitch) complex64: the sums along axis 0 for 5 shifts, then (sum of |X|^2, real part of X at i = 0). out
// (count, 30, pitch) complex64: the sums along axes 0 and 1 for 5 x 5 shifts, then a row of (sum of |X|^2, real part of
// X at i = j = 0), and 4 unused. A work-item takes LANES numbers at a time: 8 on a CPU, 1 on a GPU.
#ifndef LANES
#define LANES 8
#endif
#if LANES == 8
#define LANE float8
#define ALIKE int8
#define NUMBER float16
#define GET vload16
#define PUT vstore16
#else
#define LANE float
#define ALIKE int
#define NUMBER float2
#define GET vload2
#define PUT vstore2
#endif
#include "pomf/whitening.cl"

static inline void add_turned(LANE* const re, LANE* const im, const LANE xr, const LANE xi, const float2 turn) {
    *re += xr * turn.x - xi * turn.y;
    *im += xr * turn.y + xi * turn.x;
}

// The sums along axis 0 of spectrum `number`, a work-item per LANES columns; on a CPU the last forward pass does this.
__kernel void sum_columns(__global const float* restrict spectra, __global const float* const restrict target,
                          __global const float* const restrict across, __global const float* const restrict along,
                          __global const float* const restrict roots, const int shift, __global float* const sums,
                          const int n0, const int columns, const float exponent, const int number) {
    const int n = get_global_id(0);
    if (n * LANES >= columns) return;
    spectra += (size_t)2 * number * n0 * columns;
    LANE re[5], im[5];
    for (int a = 0; a < 5; ++a) re[a] = im[a] = 0.0f;
    LANE power = 0.0f, origin = 0.0f;
    for (int i = 0; i < n0; ++i) {
        const size_t at = (size_t)i * (columns / LANES) + n;
        const NUMBER t = GET(at, target), s = GET(at, spectra);
        LANE xr, xi;
#if LANES == 8
        const LANE gain = vload8(n, across) * along[i];
#else
        const LANE gain = across[n] * along[i];
#endif
        whitened_product(t.even, t.odd, s.even, s.odd, gain, exponent, &xr, &xi);
        power += xr * xr + xi * xi;
        if (i == 0) origin = xr;
        for (int a = 0; a < 5; ++a)
            add_turned(re + a, im + a, xr, xi, vload2(i * ((shift + a + n0 - 2) % n0) % n0, roots));
    }
    NUMBER result;
    for (int a = 0; a < 5; ++a) {
        result.even = re[a];
        result.odd = im[a];
        PUT(result, a * (columns / LANES) + n, sums);
    }
    result.even = power;
    result.odd = origin;
    PUT(result, 5 * (columns / LANES) + n, sums);
}

// The sums along axis 1, a work-item per LANES numbers of a row and shift along axis 0.
__kernel void sum_rows(__global const float* const restrict sums, __global const float* const restrict roots,
                       __global float* const restrict out, const int shift, const int n1, const int pitch,
                       const int first) {
    const int k = get_global_id(0), a = get_global_id(1), row = pitch / LANES;
    if (k >= row) return;
    const size_t from = (size_t)a * n1 * row + k, to = ((size_t)first * 30 + 5 * a) * row + k;
    LANE re[5], im[5];
    for (int b = 0; b < 5; ++b) re[b] = im[b] = 0.0f;
    for (int j = 0; j < n1; ++j) {
        const NUMBER x = GET(from + (size_t)j * row, sums);
        if (a == 5) {
            re[0] += x.even;
            if (j == 0) im[0] = x.odd;
            continue;
        }
        for (int b = 0; b < 5; ++b)
            add_turned(re + b, im + b, x.even, x.odd, vload2(j * ((shift + b + n1 - 2) % n1) % n1, roots));
    }
    NUMBER result;
    for (int b = 0; b < 5; ++b) {
        result.even = re[b];
        result.odd = im[b];
        PUT(result, to + b * row, out);
    }
}

// Trilinear, cyclic samples (cubes, count) float32 of correlations (cubes, edge, edge, edge) at places (count, 4)
// [voxels], whose fourth number is unused. One work-item: one cube and place.
__kernel void sample(__global const float* restrict values, __global const float* const restrict places,
                     __global float* const restrict out, const int edge, const int count) {
    const int n = get_global_id(0), cube = get_global_id(1);
    values += (size_t)cube * edge * edge * edge;
    const float4 place = vload4(n, places), low = floor(place), share = place - low;
    const int4 begin = convert_int4(low);
    float sum = 0.0f;
    for (int corner = 0; corner < 8; ++corner) {
        const int4 side = (int4)(corner >> 2, corner >> 1 & 1, corner & 1, 0);
        const float4 weight = select(1.0f - share, share, side == 1);
        const int4 at = ((begin + side) % edge + edge) % edge;
        sum += weight.x * weight.y * weight.z * values[((size_t)at.x * edge + at.y) * edge + at.z];
    }
    out[(size_t)cube * count + n] = sum;
}
