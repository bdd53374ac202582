// Inner products of layers' coefficients, and their weighted sums.
//
// Layout: coefficients (DEGREES, layers, ORDERS) complex64, of degree 2 p and order index - (BANDWIDTH - 1), 0 where
// the order is above the degree.
// Precondition: BANDWIDTH is at least 8.
#ifndef BANDWIDTH
#define BANDWIDTH 48
#endif
#define ORDERS (2 * BANDWIDTH - 1)

// Real parts of the inner products of two layers over the orders, by degree: (DEGREES, layers, layers) float32.
__kernel void products(__global const float* const restrict coefficients, __global float* const restrict out,
                       const int layers) {
    const int second = get_global_id(0);
    const int first = get_global_id(1);
    const int pair = get_global_id(2);
    if (second >= layers) return;
    __global const float* const a = coefficients + 2 * (size_t)(pair * layers + first) * ORDERS;
    __global const float* const b = coefficients + 2 * (size_t)(pair * layers + second) * ORDERS;
    const int begin = 2 * (BANDWIDTH - 1 - 2 * pair);
    const int end = 2 * ORDERS - begin;
    int n = begin;
    float sum = 0.0f;
#ifndef GPU
    float16 sums = 0.0f;
    for (; n + 16 <= end; n += 16) sums += vload16(0, a + n) * vload16(0, b + n);
    const float8 half_sums = sums.lo + sums.hi;
    sum = dot(half_sums.lo + half_sums.hi, (float4)(1.0f));
#endif
    for (; n < end; ++n) sum += a[n] * b[n];
    out[((size_t)pair * layers + first) * layers + second] = sum;
}

// Weighted sums of layers, by degree: mixtures (DEGREES, sums, layers) float32, out (DEGREES, sums, ORDERS) complex64.
// One work-item: 16 numbers on a CPU, one on a GPU.
__kernel void mix_layers(__global const float* const restrict coefficients, __global const float* const restrict mixtures,
                  __global float* const restrict out, const int layers) {
    const int sums = get_global_size(1);
    const size_t row = (size_t)get_global_id(2) * sums + get_global_id(1);
    __global const float* const from = coefficients + 2 * (size_t)get_global_id(2) * layers * ORDERS;
#ifndef GPU
    // the last work-item overlaps the one before
    const int n = min(16 * (int)get_global_id(0), 2 * ORDERS - 16);
    float16 sum = 0.0f;
    for (int layer = 0; layer < layers; ++layer)
        sum += mixtures[row * layers + layer] * vload16(0, from + 2 * layer * ORDERS + n);
    vstore16(sum, 0, out + 2 * row * ORDERS + n);
#else
    const int n = get_global_id(0);
    if (n >= 2 * ORDERS) return;
    float sum = 0.0f;
    for (int layer = 0; layer < layers; ++layer) sum += mixtures[row * layers + layer] * from[2 * layer * ORDERS + n];
    out[2 * row * ORDERS + n] = sum;
#endif
}
