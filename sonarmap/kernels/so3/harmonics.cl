// Spherical-harmonic coefficients of a magnitude spectrum's layers, without storing the layers' samples.
//
// Layout: magnitude (EDGE, EDGE, EDGE/2 + 1) float32, centered in axes 0 and 1. Latitudes are LATITUDES rings of
// LONGITUDES samples each; rings (2, LATITUDES) float32 holds their sines and cosines of the polar angle, circle
// (LONGITUDES, 2) the cosines and sines of the longitude. weights (LATITUDES) float32 are the rings' shares of a mean
// over the sphere. WAVE and LEGENDRE index waves and legendre; turns are the cosines and sines of order times
// longitude, as stated above each `waves`. moments (2, layers, LATITUDES) float32: each ring's mean and variance.
// coefficients (DEGREES, layers, ORDERS) complex64, degree 2 p, order index - (BANDWIDTH - 1).
// Precondition: LATITUDES is a multiple of 16, LONGITUDES of 4, BANDWIDTH of 8; every radius is in [0, EDGE/2 - 1).
#ifndef EDGE
#define EDGE 128
#endif
#ifndef BANDWIDTH
#define BANDWIDTH 48
#endif
#ifndef LATITUDES
#define LATITUDES 96
#endif
#ifndef LONGITUDES
#define LONGITUDES 256
#endif
#define DEPTH (EDGE / 2 + 1)
#define ORDERS (2 * BANDWIDTH - 1)
#define DEGREES (BANDWIDTH / 2)
#define QUARTER (LONGITUDES / 4 + 1)

#define CONSTANT 2e-6f  // share of the mean up to which a layer's deviation is only rounding

// The samples at longitudes t, pi - t, pi + t and -t have the same cosines and sines of an order, but for signs: they
// fold to a quarter circle, once for the even orders and once for the odd ones. At its two ends b and d are 0.
#define FOLD(j)                              \
    even_cosines[j] = (a + d) + (b + c);     \
    even_sines[j] = (a - d) - (b - c);       \
    odd_cosines[j] = (a + d) - (b + c);      \
    odd_sines[j] = (a - d) + (b - c);

// a[l, -m] = (-1)^m conj(a[l, m]); coefficients with |m| above l are 0.
#define STORE(re, im)                                                                              \
    {                                                                                              \
        __global float* const middle =                                                             \
            coefficients + 2 * ((size_t)(pair * layers + layer) * ORDERS + BANDWIDTH - 1);         \
        const float2 value = (float2)(re, im);                                                     \
        vstore2((order % 2 ? -1.0f : 1.0f) * (float2)(value.x, -value.y), 0, middle - 2 * order);  \
        vstore2(value, 0, middle + 2 * order);                                                     \
    }

#ifndef GPU
#define AT_ONCE 4
#define WAVE(layer, order, part, ring) ((((size_t)(layer) * BANDWIDTH + (order)) * 2 + (part)) * LATITUDES + (ring))
#define LEGENDRE(pair, order, ring) (((size_t)(order) * DEGREES + (pair)) * LATITUDES + (ring))

// Four pairs of neighbors along k_z, interpolated along it, then along the others.
static float8 sample8(__global const float* const restrict magnitude, const float8 px, const float8 py, const int8 iz,
                      const float8 fz) {
    const int8 ix = min(convert_int8(px), EDGE - 2);
    const int8 iy = min(convert_int8(py), EDGE - 2);
    const float8 fx = px - convert_float8(ix);
    const float8 fy = py - convert_float8(iy);
    const int8 base = (ix * EDGE + iy) * DEPTH + iz;
#define ALONG_Z(name, first)                                                                                      \
    const int8 at_##name = base + (first);                                                                        \
    const float16 both_##name =                                                                                   \
        (float16)(vload2(0, magnitude + at_##name.s0), vload2(0, magnitude + at_##name.s1),                       \
                  vload2(0, magnitude + at_##name.s2), vload2(0, magnitude + at_##name.s3),                       \
                  vload2(0, magnitude + at_##name.s4), vload2(0, magnitude + at_##name.s5),                       \
                  vload2(0, magnitude + at_##name.s6), vload2(0, magnitude + at_##name.s7));                      \
    const float8 name = fma(fz, both_##name.odd - both_##name.even, both_##name.even);
    ALONG_Z(v00, 0)
    ALONG_Z(v01, DEPTH)
    ALONG_Z(v10, EDGE * DEPTH)
    ALONG_Z(v11, EDGE * DEPTH + DEPTH)
    const float8 v0 = fma(fy, v01 - v00, v00);
    const float8 v1 = fma(fy, v11 - v10, v10);
    return fma(fx, v1 - v0, v0);
}

static float16 sample16(__global const float* const restrict magnitude, const float16 across, const float2 direction,
                        const int16 iz, const float16 fz) {
    const float16 px = fma(across, (float16)(direction.x), (float16)(EDGE / 2));
    const float16 py = fma(across, (float16)(direction.y), (float16)(EDGE / 2));
    return (float16)(sample8(magnitude, px.lo, py.lo, iz.lo, fz.lo), sample8(magnitude, px.hi, py.hi, iz.hi, fz.hi));
}

// One work-item: 16 rings of one layer, sampled all around, their orders 0..BANDWIDTH - 1 and their moments. turns are
// (2, BANDWIDTH / 8, QUARTER, 8): for even and odd orders, four of them at a time, cosine and sine in turn.
__kernel void waves(__global const float* const restrict magnitude, __global const float* const restrict rings,
                    __global const float* const restrict circle, __global const float* const restrict radii,
                    __global const float* const restrict turns, __global float* const restrict out,
                    __global float* const restrict moments) {
    const int ring = 16 * get_global_id(0);
    const int layer = get_global_id(1);
    const float radius = radii[layer];
    const float16 across = radius * vload16(0, rings + ring);
    const float16 pz = radius * vload16(0, rings + LATITUDES + ring);
    const int16 iz = convert_int16(pz);
    const float16 fz = pz - convert_float16(iz);
    float16 even_cosines[QUARTER], even_sines[QUARTER], odd_cosines[QUARTER], odd_sines[QUARTER];
    const float16 first = sample16(magnitude, across, vload2(0, circle), iz, fz);
    float16 sum = 0.0f;
    float16 squares = 0.0f;
    for (int j = 0; j <= LONGITUDES / 4; ++j) {
        // less the first sample, which keeps the moments precise and changes order 0 only
        const bool twice = j > 0 && j < LONGITUDES / 4;
        const float16 a = sample16(magnitude, across, vload2(j, circle), iz, fz) - first;
        const float16 c = sample16(magnitude, across, vload2(LONGITUDES / 2 + j, circle), iz, fz) - first;
        float16 b = 0.0f;
        float16 d = 0.0f;
        if (twice) {
            b = sample16(magnitude, across, vload2(LONGITUDES / 2 - j, circle), iz, fz) - first;
            d = sample16(magnitude, across, vload2(LONGITUDES - j, circle), iz, fz) - first;
        }
        sum += (a + b) + (c + d);
        squares += (a * a + b * b) + (c * c + d * d);
        FOLD(j)
    }
    const float16 mean = sum / LONGITUDES;
    vstore16(first + mean, 0, moments + (size_t)layer * LATITUDES + ring);
    vstore16(fmax(squares / LONGITUDES - mean * mean, 0.0f), 0,
             moments + ((size_t)get_global_size(1) + layer) * LATITUDES + ring);
    for (int odd = 0; odd < 2; ++odd) {
        const float16* const cosines = odd ? odd_cosines : even_cosines;
        const float16* const sines = odd ? odd_sines : even_sines;
        for (int block = 0; block < BANDWIDTH / (2 * AT_ONCE); ++block) {
            __global const float* turn = turns + (size_t)(odd * (BANDWIDTH / 8) + block) * QUARTER * 8;
            float16 re0 = 0.0f, re1 = 0.0f, re2 = 0.0f, re3 = 0.0f;
            float16 im0 = 0.0f, im1 = 0.0f, im2 = 0.0f, im3 = 0.0f;
            for (int j = 0; j < QUARTER; ++j, turn += 8) {
                const float16 x = cosines[j];
                const float16 y = sines[j];
                re0 += x * turn[0];
                im0 -= y * turn[1];
                re1 += x * turn[2];
                im1 -= y * turn[3];
                re2 += x * turn[4];
                im2 -= y * turn[5];
                re3 += x * turn[6];
                im3 -= y * turn[7];
            }
            const int order = 2 * AT_ONCE * block + odd;
            vstore16(re0, 0, out + WAVE(layer, order, 0, ring));
            vstore16(im0, 0, out + WAVE(layer, order, 1, ring));
            vstore16(re1, 0, out + WAVE(layer, order + 2, 0, ring));
            vstore16(im1, 0, out + WAVE(layer, order + 2, 1, ring));
            vstore16(re2, 0, out + WAVE(layer, order + 4, 0, ring));
            vstore16(im2, 0, out + WAVE(layer, order + 4, 1, ring));
            vstore16(re3, 0, out + WAVE(layer, order + 6, 0, ring));
            vstore16(im3, 0, out + WAVE(layer, order + 6, 1, ring));
        }
    }
}

static float sum16(const float16 v) {
    const float8 a = v.lo + v.hi;
    const float4 b = a.lo + a.hi;
    const float2 c = b.lo + b.hi;
    return c.x + c.y;
}
#else
#define GROUP 64
#define WAVE(layer, order, part, ring) ((((size_t)(layer) * LATITUDES + (ring)) * 2 + (part)) * BANDWIDTH + (order))
#define LEGENDRE(pair, order, ring) (((size_t)(pair) * LATITUDES + (ring)) * BANDWIDTH + (order))

static float sample(__global const float* const restrict magnitude, const float across, const float2 direction,
                    const int iz, const float fz) {
    const float px = fma(across, direction.x, (float)(EDGE / 2));
    const float py = fma(across, direction.y, (float)(EDGE / 2));
    const int ix = min((int)px, EDGE - 2);
    const int iy = min((int)py, EDGE - 2);
    __global const float* const at = magnitude + ((size_t)ix * EDGE + iy) * DEPTH + iz;
    const float v00 = fma(fz, at[1] - at[0], at[0]);
    const float v01 = fma(fz, at[DEPTH + 1] - at[DEPTH], at[DEPTH]);
    const float v10 = fma(fz, at[EDGE * DEPTH + 1] - at[EDGE * DEPTH], at[EDGE * DEPTH]);
    const float v11 = fma(fz, at[EDGE * DEPTH + DEPTH + 1] - at[EDGE * DEPTH + DEPTH], at[EDGE * DEPTH + DEPTH]);
    const float v0 = fma(py - iy, v01 - v00, v00);
    const float v1 = fma(py - iy, v11 - v10, v10);
    return fma(px - ix, v1 - v0, v0);
}

// One work-group: one ring of one layer, sampled all around. turns are (2, QUARTER, BANDWIDTH): cosines, then sines.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void waves(
    __global const float* const restrict magnitude, __global const float* const restrict rings,
    __global const float* const restrict circle, __global const float* const restrict radii,
    __global const float* const restrict turns, __global float* const restrict out,
    __global float* const restrict moments) {
    __local float samples[LONGITUDES], sums[GROUP], squares[GROUP];
    __local float even_cosines[QUARTER], even_sines[QUARTER], odd_cosines[QUARTER], odd_sines[QUARTER];
    const int item = get_local_id(0);
    const int ring = get_group_id(0);
    const int layer = get_global_id(1);
    const float across = radii[layer] * rings[ring];
    const float pz = radii[layer] * rings[LATITUDES + ring];
    const int iz = (int)pz;
    const float first = sample(magnitude, across, vload2(0, circle), iz, pz - iz);
    float sum = 0.0f;
    float square = 0.0f;
    for (int j = item; j < LONGITUDES; j += GROUP) {
        const float value = sample(magnitude, across, vload2(j, circle), iz, pz - iz) - first;
        samples[j] = value;
        sum += value;
        square += value * value;
    }
    sums[item] = sum;
    squares[item] = square;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int j = item; j < QUARTER; j += GROUP) {
        const bool twice = j > 0 && j < LONGITUDES / 4;
        const float a = samples[j];
        const float b = twice ? samples[LONGITUDES / 2 - j] : 0.0f;
        const float c = samples[LONGITUDES / 2 + j];
        const float d = twice ? samples[LONGITUDES - j] : 0.0f;
        FOLD(j)
    }
    for (int half_group = GROUP / 2; half_group > 0; half_group /= 2) {
        if (item < half_group) {
            sums[item] += sums[item + half_group];
            squares[item] += squares[item + half_group];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (item == 0) {
        const float mean = sums[0] / LONGITUDES;
        moments[(size_t)layer * LATITUDES + ring] = first + mean;
        moments[((size_t)get_global_size(1) + layer) * LATITUDES + ring] =
            fmax(squares[0] / LONGITUDES - mean * mean, 0.0f);
    }
    for (int order = item; order < BANDWIDTH; order += GROUP) {
        __local const float* const cosines = order % 2 ? odd_cosines : even_cosines;
        __local const float* const sines = order % 2 ? odd_sines : even_sines;
        float re = 0.0f;
        float im = 0.0f;
        for (int j = 0; j < QUARTER; ++j) {
            re += cosines[j] * turns[j * BANDWIDTH + order];
            im -= sines[j] * turns[(QUARTER + j) * BANDWIDTH + order];
        }
        out[WAVE(layer, order, 0, ring)] = re;
        out[WAVE(layer, order, 1, ring)] = im;
    }
}
#endif

// Coefficients of the layers, normalized to mean 0 and variance 1 over the sphere. One work-item: one order, of both
// signs, of one layer; every degree on a CPU, one degree on a GPU.
__kernel void project(__global const float* const restrict waves, __global const float* const restrict moments,
                      __global const float* const restrict weights, __global const float* const restrict legendre,
                      __global float* const restrict coefficients) {
    const int order = get_global_id(0);
    const int layer = get_global_id(1);
    const int layers = get_global_size(1);
    __global const float* const means = moments + (size_t)layer * LATITUDES;
    __global const float* const variances = means + (size_t)layers * LATITUDES;
#ifndef GPU
    float16 total = 0.0f;
    for (int ring = 0; ring < LATITUDES; ring += 16) total += vload16(0, weights + ring) * vload16(0, means + ring);
    const float mean = sum16(total);
    float16 squares = 0.0f;
    for (int ring = 0; ring < LATITUDES; ring += 16) {
        const float16 off = vload16(0, means + ring) - mean;
        squares += vload16(0, weights + ring) * (vload16(0, variances + ring) + off * off);
    }
    const float deviation = sqrt(sum16(squares));
    const float scale = deviation > CONSTANT * fabs(mean) ? 1.0f / deviation : 0.0f;
    for (int pair = 0; pair < DEGREES; ++pair) {
        float16 re = 0.0f;
        float16 im = 0.0f;
        for (int ring = 0; 2 * pair >= order && ring < LATITUDES; ring += 16) {
            const float16 factor = vload16(0, legendre + LEGENDRE(pair, order, ring));
            re += factor * (order ? vload16(0, waves + WAVE(layer, order, 0, ring))
                                  : LONGITUDES * (vload16(0, means + ring) - mean));
            im += factor * vload16(0, waves + WAVE(layer, order, 1, ring));
        }
        STORE(scale * sum16(re), order ? scale * sum16(im) : 0.0f)
    }
#else
    const int pair = get_global_id(2);
    float mean = 0.0f;
    for (int ring = 0; ring < LATITUDES; ++ring) mean += weights[ring] * means[ring];
    float square = 0.0f;
    float re = 0.0f;
    float im = 0.0f;
    for (int ring = 0; ring < LATITUDES; ++ring) {
        const float off = means[ring] - mean;
        square += weights[ring] * (variances[ring] + off * off);
        const float factor = 2 * pair >= order ? legendre[LEGENDRE(pair, order, ring)] : 0.0f;
        re += factor * (order ? waves[WAVE(layer, order, 0, ring)] : LONGITUDES * off);
        im += factor * waves[WAVE(layer, order, 1, ring)];
    }
    const float deviation = sqrt(square);
    const float scale = deviation > CONSTANT * fabs(mean) ? 1.0f / deviation : 0.0f;
    STORE(scale * re, order ? scale * im : 0.0f)
#endif
}
