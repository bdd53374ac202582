// Layers brought to zero mean and unit variance, then windowed.
//
// Layout: stack is (layers, height, width) float32; mask and window (height, width) float32, the mask 1 where a pixel
// counts and 0 elsewhere; rows (layers height, 3) float32: how many pixels of the row count, their mean, and the sum of
// their squared deviations from it; scales (layers, 2) float32: the layer's mean and 1 / its standard deviation.
// Deviations are taken about each row's own mean and then joined, so that a large mean costs no precision.
// Precondition: none of the numbers that count is infinite or NaN. Launched in the order of this file.
#ifndef CONSTANT
#define CONSTANT 2e-6f  // a layer whose deviation is this share of its mean or less is constant but for rounding
#endif

// One work-item per row.
__kernel void row_moments(__global const float* const restrict stack, __global const float* const restrict mask,
                          __global float* const restrict rows, const int height, const int width) {
    const size_t r = get_global_id(0);
    __global const float* const row = stack + r * width;
    __global const float* const valid = mask + (r % height) * width;
    float count = 0.0f;
    float sum = 0.0f;
    for (int j = 0; j < width; j += 8) {
        const float8 m = vload8(0, valid + j);
        const float8 v = select((float8)(0.0f), vload8(0, row + j), m != 0.0f);
        const float4 m4 = m.lo + m.hi;
        const float4 v4 = v.lo + v.hi;
        count += (m4.x + m4.y) + (m4.z + m4.w);
        sum += (v4.x + v4.y) + (v4.z + v4.w);
    }
    const float mean = count > 0.0f ? sum / count : 0.0f;
    float8 squares = 0.0f;
    for (int j = 0; j < width; j += 8) {
        const float8 d = select((float8)(0.0f), vload8(0, row + j) - mean, vload8(0, valid + j) != 0.0f);
        squares += d * d;
    }
    const float4 s4 = squares.lo + squares.hi;
    vstore3((float3)(count, mean, (s4.x + s4.y) + (s4.z + s4.w)), r, rows);
}

// One work-item per layer.
__kernel void layer_moments(__global const float* const restrict rows, __global float* const restrict scales,
                            const int height) {
    const size_t l = get_global_id(0);
    const size_t first = l * height;
    float count = 0.0f;
    float sum = 0.0f;
    for (int i = 0; i < height; ++i) {
        const float3 row = vload3(first + i, rows);
        count += row.x;
        sum = fma(row.x, row.y, sum);
    }
    const float mean = count > 0.0f ? sum / count : 0.0f;
    float squares = 0.0f;
    for (int i = 0; i < height; ++i) {
        const float3 row = vload3(first + i, rows);
        squares += fma(row.x, (row.y - mean) * (row.y - mean), row.z);
    }
    const float deviation = count > 0.0f ? sqrt(squares / count) : 0.0f;
    vstore2((float2)(mean, deviation > CONSTANT * fabs(mean) ? 1.0f / deviation : 0.0f), l, scales);
}

// One work-item per row; out may be the stack itself.
__kernel void apply(__global const float* const stack, __global const float* const restrict mask,
                    __global const float* const restrict window, __global const float* const restrict scales,
                    __global float* const out, const int height, const int width) {
    const size_t r = get_global_id(0);
    const size_t at = r * width;
    const size_t pixel = (r % height) * width;
    const float2 scale = vload2(r / height, scales);
    for (int j = 0; j < width; j += 8) {
        const float8 v = (vload8(0, stack + at + j) - scale.x) * scale.y * vload8(0, window + pixel + j);
        vstore8(select((float8)(0.0f), v, vload8(0, mask + pixel + j) != 0.0f), 0, out + at + j);
    }
}
