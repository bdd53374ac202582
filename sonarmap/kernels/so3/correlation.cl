// The correlation of two functions on the sphere over all rotations: from their coefficients to half spectra of images
// over the first and third Euler angle, one image for each second one. Several parts of the layers at once.
//
// Layout: target and source (DEGREES, layers, ORDERS) complex64, the coefficients of degree 2 p and order
// m = index - (BANDWIDTH - 1); ranges (PARTS, 2) int32, the first layer of each part and their number. products and
// wigner, d[2 p, m, n](beta), are for n >= 0: on a CPU (PARTS, ORDERS, BANDWIDTH / 8, DEGREES, 8) complex64 and
// (ORDERS, betas, BANDWIDTH / 8, DEGREES, 8) float32, in blocks of 8, so that `synthesize` reads all degrees of a block
// in a row; on a GPU (PARTS, ORDERS, DEGREES, BANDWIDTH) and (ORDERS, betas, DEGREES, BANDWIDTH), so that adjacent
// work-items read adjacent memory. Numbers with n beyond the degree's block or |m| above the degree are never read.
// out (PARTS, images, EDGE, PITCH) complex64, half spectra as kernels/fft/transform.py has them: m along axis 2
// (cyclic), n along axis 3. Images beyond the betas become 0.
// Precondition: BANDWIDTH is a multiple of 8 and at most EDGE / 2.
#ifndef BANDWIDTH
#define BANDWIDTH 48
#endif
#ifndef EDGE
#define EDGE 128
#endif
#ifndef PARTS
#define PARTS 1
#endif
#define ORDERS (2 * BANDWIDTH - 1)
#define DEGREES (BANDWIDTH / 2)
#define PITCH (EDGE / 16 * 8 + 8)

#ifndef GPU
// gain times the sums over a part's layers of target[m] conj(source[n]). One work-item: one order m of one degree.
__kernel void multiply(__global const float* const restrict target, __global const float* const restrict source,
                       __global const int* const restrict ranges, __global float* const restrict products,
                       const int layers, const float gain) {
    const int row = get_global_id(0);
    const int pair = get_global_id(1);
    const int part = get_global_id(2);
    if (abs(row - (BANDWIDTH - 1)) > 2 * pair) return;
    const int begin = ranges[2 * part];
    const int end = begin + ranges[2 * part + 1];
    const size_t first = (size_t)pair * layers * ORDERS;
    for (int n = 0; n <= 2 * pair; n += 8) {
        float8 re = 0.0f;
        float8 im = 0.0f;
        for (int layer = begin; layer < end; ++layer) {
            const size_t at = first + (size_t)layer * ORDERS;
            const float2 a = gain * vload2(at + row, target);
            const float16 b = vload16(0, source + 2 * (at + BANDWIDTH - 1 + n));
            re += a.x * b.even + a.y * b.odd;
            im += a.y * b.even - a.x * b.odd;
        }
        float16 sum;
        sum.even = re;
        sum.odd = im;
        vstore16(sum, (((size_t)part * ORDERS + row) * (BANDWIDTH / 8) + n / 8) * DEGREES + pair, products);
    }
}

// One work-item: one row of one image of every part; work-items of the same row share its products.
__kernel void synthesize(__global const float* const restrict wigner, __global const float* const restrict products,
                         __global float* const restrict out, const int betas) {
    const int beta = get_global_id(0);
    const int row = get_global_id(1);
    const int order = row < EDGE / 2 ? row : row - EDGE;
    const int least = abs(order);
    const size_t step = (size_t)ORDERS * (BANDWIDTH / 8) * DEGREES;
    __global float* const to = out + 2 * ((size_t)beta * EDGE + row) * PITCH;
    const size_t next = 2 * get_global_size(0) * (size_t)EDGE * PITCH;
    int n = 0;
    for (; beta < betas && least < BANDWIDTH && n < BANDWIDTH; n += 8) {
        const size_t from = ((size_t)(order + BANDWIDTH - 1) * (BANDWIDTH / 8) + n / 8) * DEGREES;
        const size_t at = (((size_t)(order + BANDWIDTH - 1) * betas + beta) * (BANDWIDTH / 8) + n / 8) * DEGREES;
        float16 sums[PARTS];
        for (int part = 0; part < PARTS; ++part) sums[part] = 0.0f;
        for (int pair = max((least + 1) / 2, n / 2); pair < DEGREES; ++pair) {
            const float8 d = vload8(at + pair, wigner);
            const float16 both = (float16)(d.s0, d.s0, d.s1, d.s1, d.s2, d.s2, d.s3, d.s3, d.s4, d.s4, d.s5, d.s5,
                                           d.s6, d.s6, d.s7, d.s7);
#pragma unroll
            for (int part = 0; part < PARTS; ++part) sums[part] += both * vload16(part * step + from + pair, products);
        }
        for (int part = 0; part < PARTS; ++part) vstore16(sums[part], 0, to + part * next + 2 * n);
    }
    for (; n < PITCH; n += 8)
        for (int part = 0; part < PARTS; ++part) vstore16((float16)(0.0f), 0, to + part * next + 2 * n);
}
#else
// The same; one work-item: one number.
__kernel void multiply(__global const float* const restrict target, __global const float* const restrict source,
                       __global const int* const restrict ranges, __global float* const restrict products,
                       const int layers, const float gain) {
    const int n = get_global_id(0);
    const int row = get_global_id(1);
    const int pair = get_global_id(2) % DEGREES;
    const int part = get_global_id(2) / DEGREES;
    if (abs(row - (BANDWIDTH - 1)) > 2 * pair || n > 2 * pair) return;
    const int begin = ranges[2 * part];
    const int end = begin + ranges[2 * part + 1];
    float2 sum = 0.0f;
    for (int layer = begin; layer < end; ++layer) {
        const size_t at = ((size_t)pair * layers + layer) * ORDERS;
        const float2 a = gain * vload2(at + row, target);
        const float2 b = vload2(at + BANDWIDTH - 1 + n, source);
        sum += (float2)(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y);
    }
    vstore2(sum, (((size_t)part * ORDERS + row) * DEGREES + pair) * BANDWIDTH + n, products);
}

// One work-item: one number of every part.
__kernel void synthesize(__global const float* const restrict wigner, __global const float* const restrict products,
                         __global float* const restrict out, const int betas) {
    const int n = get_global_id(0);
    const int row = get_global_id(1);
    const int beta = get_global_id(2);
    if (n >= PITCH) return;
    const int order = row < EDGE / 2 ? row : row - EDGE;
    const size_t from = (size_t)(order + BANDWIDTH - 1) * DEGREES * BANDWIDTH + n;
    const size_t at = ((size_t)(order + BANDWIDTH - 1) * betas + beta) * DEGREES * BANDWIDTH + n;
    float2 sums[PARTS];
    for (int part = 0; part < PARTS; ++part) sums[part] = 0.0f;
    const bool empty = beta >= betas || abs(order) >= BANDWIDTH || n >= BANDWIDTH;
    for (int pair = empty ? DEGREES : (max((int)abs(order), n) + 1) / 2; pair < DEGREES; ++pair) {
        const float d = wigner[at + pair * BANDWIDTH];
        for (int part = 0; part < PARTS; ++part)
            sums[part] += d * vload2((size_t)part * ORDERS * DEGREES * BANDWIDTH + from + pair * BANDWIDTH, products);
    }
    for (int part = 0; part < PARTS; ++part)
        vstore2(sums[part], (((size_t)part * get_global_size(2) + beta) * EDGE + row) * PITCH + n, out);
}
#endif

#include "so3/peaks.cl"
