// Normalize layers to mean 0 and variance 1, then multiply them by a window.
//
// Layout: stack is (layers, height, width) float32; mask and window (height, width) float32, the mask 1 where a pixel
// counts and 0 elsewhere; rows (layers height, 3) float32: the number of the row's pixels that count, their mean, and
// the sum of their squared deviations from it; scales (layers, 2) float32: the layer's mean and 1 / its standard
// deviation. Deviations are taken about each row's own mean and then joined, so that a large mean costs no precision.
// Precondition: all pixels that count are finite. Launch the kernels in the order of this file.
#include "device/lanes.cl"
#ifndef CONSTANT
#define CONSTANT 2e-6f  // share of the mean up to which a layer's deviation is only rounding
#endif

// One group per row.
__kernel void row_moments(__global const float* const restrict stack, __global const float* const restrict mask,
                          __global float* const restrict rows, const int height, const int width) {
    SCRATCH(scratch);
    const size_t r = get_group_id(0);
    __global const float* const row = stack + r * width;
    __global const float* const valid = mask + (r % height) * width;
    floatn counts = 0.0f, sums = 0.0f, squares = 0.0f;
    for (SHARED(j, width)) {
        const floatn m = loadn(valid + j);
        counts += m;
        sums += select((floatn)(0.0f), loadn(row + j), m != 0.0f);
    }
    const float count = group_sum(lane_sum(counts), scratch);
    const float sum = group_sum(lane_sum(sums), scratch);
    const float mean = count > 0.0f ? sum / count : 0.0f;
    for (SHARED(j, width)) {
        const floatn d = select((floatn)(0.0f), loadn(row + j) - mean, loadn(valid + j) != 0.0f);
        squares += d * d;
    }
    const float total = group_sum(lane_sum(squares), scratch);
    if (get_local_id(0) == 0) vstore3((float3)(count, mean, total), r, rows);
}

// One group per layer.
__kernel void layer_moments(__global const float* const restrict rows, __global float* const restrict scales,
                            const int height) {
    SCRATCH(scratch);
    const size_t l = get_group_id(0);
    const size_t first = l * height;
    float counts = 0.0f, sums = 0.0f, squares = 0.0f;
    for (int i = get_local_id(0); i < height; i += get_local_size(0)) {
        const float3 row = vload3(first + i, rows);
        counts += row.x;
        sums = fma(row.x, row.y, sums);
    }
    const float count = group_sum(counts, scratch);
    const float sum = group_sum(sums, scratch);
    const float mean = count > 0.0f ? sum / count : 0.0f;
    for (int i = get_local_id(0); i < height; i += get_local_size(0)) {
        const float3 row = vload3(first + i, rows);
        squares += fma(row.x, (row.y - mean) * (row.y - mean), row.z);
    }
    const float total = group_sum(squares, scratch);
    const float deviation = count > 0.0f ? sqrt(total / count) : 0.0f;
    if (get_local_id(0) == 0)
        vstore2((float2)(mean, deviation > CONSTANT * fabs(mean) ? 1.0f / deviation : 0.0f), l, scales);
}

// One work-item per row, or per pixel; out may be the stack itself.
__kernel void apply(__global const float* const stack, __global const float* const restrict mask,
                    __global const float* const restrict window, __global const float* const restrict scales,
                    __global float* const out, const int layers, const int height, const int width) {
    const int i = get_global_id(1);
    const int l = get_global_id(2);
    if (i >= height || l >= layers) return;
    const size_t at = ((size_t)l * height + i) * width;
    const size_t pixel = (size_t)i * width;
    const float2 scale = vload2(l, scales);
    for (ALONG(j, width)) {
        const floatn v = (loadn(stack + at + j) - scale.x) * scale.y * loadn(window + pixel + j);
        storen(select((floatn)(0.0f), v, loadn(mask + pixel + j) != 0.0f), out + at + j);
    }
}
