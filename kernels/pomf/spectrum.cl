// Half spectra of real volumes: magnitude, whitening, cross-power.
//
// Layout: complex64 as interleaved floats, C order; a row (last axis) is PITCH complex numbers of which the first
// N/2 + 1 are valid and the rest is padding. PITCH is a multiple of 8, so rows are walked 8 numbers at a time;
// whatever the padding holds, whitening leaves finite numbers in it and cross-powers multiply it by 0.
// Precondition: the axes before the last are even (for the centering).
#include "pomf/whitening.cl"

// F / |F|^exponent, and 0 where |F| is at most FLOOR, infinite or not a number.
__kernel void whiten(__global const float* const spectrum, __global float* const out, const float exponent) {
    const size_t n = get_global_id(0);
    const float16 value = vload16(n, spectrum);
    const float8 scale = whitening(value.even * value.even + value.odd * value.odd, exponent);
    float16 result;
    // select, not a product with 0: infinity and NaN times 0 are NaN
    result.even = select((float8)(0.0f), value.even * scale, scale > 0.0f);
    result.odd = select((float8)(0.0f), value.odd * scale, scale > 0.0f);
    vstore16(result, n, out);
}

// |F|, centered in axes 0 and 1: row (i, j) of the result is row (i - n0/2, j - n1/2), modulo the size.
__kernel void magnitude(__global const float* const restrict spectrum, __global float* const restrict out,
                        const int n0, const int n1, const int nyquist, const int pitch) {
    const int j = get_global_id(0);
    const int i = get_global_id(1);
    if (i >= n0 || j >= n1) return;
    const int from_i = i < n0 / 2 ? i + n0 / 2 : i - n0 / 2;
    const int from_j = j < n1 / 2 ? j + n1 / 2 : j - n1 / 2;
    __global const float* const row = spectrum + 2 * (size_t)(from_i * n1 + from_j) * pitch;
    __global float* const to = out + (size_t)(i * n1 + j) * (nyquist + 1);
    int k = 0;
    for (; k + 8 <= nyquist; k += 8) {
        const float16 value = vload16(0, row + 2 * k);
        vstore8(sqrt(value.even * value.even + value.odd * value.odd), 0, to + k);
    }
    for (; k <= nyquist; ++k) {
        const float2 value = vload2(k, row);
        to[k] = sqrt(value.x * value.x + value.y * value.y);
    }
}

// target conj(source) of 8 numbers.
static float16 cross8(const float16 target, const float16 source) {
    float16 result;
    result.even = target.even * source.even + target.odd * source.odd;
    result.odd = target.odd * source.even - target.even * source.odd;
    return result;
}

// The product with gains along the three axes: gain0 (n0), gain1 (n1), gain2 (pitch, 0 in the padding).
__kernel void cross_power(__global const float* const target, __global const float* const source,
                          __global float* const out, __global const float* const restrict gain0,
                          __global const float* const restrict gain1,
                          __global const float* const restrict gain2, const int n1, const int pitch) {
    const int j = get_global_id(0);
    const int i = get_global_id(1);
    const size_t row = 2 * (size_t)(i * n1 + j) * pitch;
    const float outer = gain0[i] * gain1[j];
    for (int k = 0; k < pitch; k += 8) {
        const size_t at = row + 2 * k;
        const float16 cross = cross8(vload16(0, target + at), vload16(0, source + at));
        const float8 gain = outer * vload8(0, gain2 + k);
        float16 result;
        result.even = cross.even * gain;
        result.odd = cross.odd * gain;
        vstore16(result, 0, out + at);
    }
}

// The same summed over layers into one image; gain1 is along its rows (n1), gain2 along its columns.
__kernel void sum_layers(__global const float* const restrict target,
                         __global const float* const restrict source, __global float* const restrict out,
                         __global const float* const restrict gain1,
                         __global const float* const restrict gain2, const int layers, const int n1,
                         const int pitch) {
    const int k = 8 * get_global_id(0);
    const int j = get_global_id(1);
    const size_t step = 2 * (size_t)n1 * pitch;
    const size_t first = 2 * ((size_t)j * pitch + k);
    float16 sum = 0.0f;
    for (int l = 0; l < layers; ++l) {
        const size_t at = first + l * step;
        sum += cross8(vload16(0, target + at), vload16(0, source + at));
    }
    const float8 gain = gain1[j] * vload8(0, gain2 + k);
    float16 result;
    result.even = sum.even * gain;
    result.odd = sum.odd * gain;
    vstore16(result, 0, out + first);
}
