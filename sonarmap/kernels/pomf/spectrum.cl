// Half spectra of real volumes: magnitude, whitening, cross-power.
//
// Layout: complex64 as interleaved floats, C order; a row (last axis) is PITCH complex numbers of which the first
// N/2 + 1 are valid and the rest is padding. PITCH is a multiple of 8, so a work-item takes LANES numbers at a
// time. The padding may hold anything: whitening makes it finite, and cross-powers multiply it by 0.
// Precondition: the axes before the last are even (for the centering).
#include "device/lanes.cl"
#define LANE floatn
#define ALIKE intn
#include "pomf/whitening.cl"

// F / |F|^exponent, and 0 where |F| is at most FLOOR, infinite or not a number. One work-item: LANES adjacent numbers.
__kernel void whiten(__global const float* const spectrum, __global float* const out, const float exponent,
                     const int count) {
    const int n = LANES * get_global_id(0);
    if (n >= count) return;
    floatn re, im;
    load_complex(spectrum + 2 * (size_t)n, &re, &im);
    const floatn scale = whitening(re * re + im * im, exponent);
    // select, not a product with 0: infinity and NaN times 0 are NaN
    store_complex(select((floatn)(0.0f), re * scale, scale > 0.0f), select((floatn)(0.0f), im * scale, scale > 0.0f),
                  out + 2 * (size_t)n);
}

// |F|, centered in axes 0 and 1: row (i, j) of the result is row (i - n0/2, j - n1/2), modulo the size.
__kernel void magnitude(__global const float* const restrict spectrum, __global float* const restrict out,
                        const int n0, const int n1, const int nyquist, const int pitch) {
    const int j = get_global_id(1);
    const int i = get_global_id(2);
    if (i >= n0 || j >= n1) return;
    const int from_i = i < n0 / 2 ? i + n0 / 2 : i - n0 / 2;
    const int from_j = j < n1 / 2 ? j + n1 / 2 : j - n1 / 2;
    __global const float* const row = spectrum + 2 * (size_t)(from_i * n1 + from_j) * pitch;
    __global float* const to = out + (size_t)(i * n1 + j) * (nyquist + 1);
    const int whole = nyquist / LANES * LANES;
    for (ALONG(k, whole)) {
        floatn re, im;
        load_complex(row + 2 * k, &re, &im);
        storen(sqrt(re * re + im * im), to + k);
    }
    if (get_global_id(0) > 0) return;
    for (int k = whole; k <= nyquist; ++k) {
        const float2 value = vload2(k, row);
        to[k] = sqrt(value.x * value.x + value.y * value.y);
    }
}

// Add the product target conj(source) of LANES numbers to re and im.
static inline void add_cross(__global const float* const target, __global const float* const source, floatn* re,
                             floatn* im) {
    floatn a, b, c, d;
    load_complex(target, &a, &b);
    load_complex(source, &c, &d);
    *re += a * c + b * d;
    *im += b * c - a * d;
}

// The product times gains along the three axes: gain0 (n0), gain1 (n1), gain2 (pitch, 0 in the padding).
__kernel void cross_power(__global const float* const target, __global const float* const source,
                          __global float* const out, __global const float* const restrict gain0,
                          __global const float* const restrict gain1, __global const float* const restrict gain2,
                          const int n0, const int n1, const int pitch) {
    const int j = get_global_id(1);
    const int i = get_global_id(2);
    if (i >= n0 || j >= n1) return;
    const size_t row = 2 * (size_t)(i * n1 + j) * pitch;
    const float outer = gain0[i] * gain1[j];
    for (ALONG(k, pitch)) {
        floatn re = 0.0f, im = 0.0f;
        add_cross(target + row + 2 * k, source + row + 2 * k, &re, &im);
        const floatn gain = outer * loadn(gain2 + k);
        store_complex(re * gain, im * gain, out + row + 2 * k);
    }
}

// The products summed over layers into one image; gain1 is along its rows (n1), gain2 along its columns. One work-item:
// LANES adjacent numbers of the image.
__kernel void sum_layers(__global const float* const restrict target, __global const float* const restrict source,
                         __global float* const restrict out, __global const float* const restrict gain1,
                         __global const float* const restrict gain2, const int layers, const int n1, const int pitch) {
    const int k = LANES * get_global_id(0);
    const int j = get_global_id(1);
    if (k >= pitch || j >= n1) return;
    const size_t step = 2 * (size_t)n1 * pitch;
    const size_t first = 2 * ((size_t)j * pitch + k);
    floatn re = 0.0f, im = 0.0f;
    for (int l = 0; l < layers; ++l) add_cross(target + first + l * step, source + first + l * step, &re, &im);
    const floatn gain = gain1[j] * loadn(gain2 + k);
    store_complex(re * gain, im * gain, out + first);
}
