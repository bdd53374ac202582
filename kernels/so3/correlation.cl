// The correlation of two functions on the sphere over all rotations: from their coefficients to half spectra of images
// over the first and third Euler angle, one image for each second one.
//
// Layout: target and source (DEGREES, layers, ORDERS) complex64, the coefficients of degree 2 p and order
// m = index - (BANDWIDTH - 1). For n >= 0, 8 at a time, all degrees behind each other, as `synthesize` walks them:
// products (ORDERS, BANDWIDTH / 8, DEGREES, 8) complex64; wigner (ORDERS, betas, BANDWIDTH / 8, DEGREES, 8) float32,
// d[2 p, m, n](beta). Of both, what has n beyond the degree's block or |m| above the degree is never read.
// out (images, EDGE, PITCH) complex64, half spectra as kernels/fft/transform.py has them: m along axis 1 (cyclic), n along
// axis 2. Images beyond the betas become 0.
// Precondition: BANDWIDTH is a multiple of 8 and at most EDGE / 2.
#ifndef BANDWIDTH
#define BANDWIDTH 48
#endif
#ifndef EDGE
#define EDGE 128
#endif
#define ORDERS (2 * BANDWIDTH - 1)
#define DEGREES (BANDWIDTH / 2)
#define PITCH (EDGE / 2 + 8)

// Times gain, the sums over the layers of target[m] conj(source[n]). One work-item: one order m of one degree.
__kernel void multiply(__global const float* const restrict target, __global const float* const restrict source,
                       __global float* const restrict products, const int layers, const float gain) {
    const int row = get_global_id(0);
    const int pair = get_global_id(1);
    if (abs(row - (BANDWIDTH - 1)) > 2 * pair) return;
    const size_t first = (size_t)pair * layers * ORDERS;
    for (int n = 0; n <= 2 * pair; n += 8) {
        float8 re = 0.0f;
        float8 im = 0.0f;
        for (int layer = 0; layer < layers; ++layer) {
            const size_t at = first + (size_t)layer * ORDERS;
            const float2 a = gain * vload2(at + row, target);
            const float16 b = vload16(0, source + 2 * (at + BANDWIDTH - 1 + n));
            re += a.x * b.even + a.y * b.odd;
            im += a.y * b.even - a.x * b.odd;
        }
        float16 sum;
        sum.even = re;
        sum.odd = im;
        vstore16(sum, ((size_t)row * (BANDWIDTH / 8) + n / 8) * DEGREES + pair, products);
    }
}

// One work-item: one row of one image; neighbors share its products.
__kernel void synthesize(__global const float* const restrict wigner, __global const float* const restrict products,
                         __global float* const restrict out, const int betas) {
    const int beta = get_global_id(0);
    const int row = get_global_id(1);
    const int order = row < EDGE / 2 ? row : row - EDGE;
    const int least = abs(order);
    __global float* const to = out + 2 * ((size_t)beta * EDGE + row) * PITCH;
    int n = 0;
    for (; beta < betas && least < BANDWIDTH && n < BANDWIDTH; n += 8) {
        const size_t from = ((size_t)(order + BANDWIDTH - 1) * (BANDWIDTH / 8) + n / 8) * DEGREES;
        const size_t at = (((size_t)(order + BANDWIDTH - 1) * betas + beta) * (BANDWIDTH / 8) + n / 8) * DEGREES;
        float16 sum = 0.0f;
        for (int pair = max((least + 1) / 2, n / 2); pair < DEGREES; ++pair) {
            const float8 d = vload8(at + pair, wigner);
            const float16 product = vload16(from + pair, products);
            sum += product * (float16)(d.s0, d.s0, d.s1, d.s1, d.s2, d.s2, d.s3, d.s3, d.s4, d.s4, d.s5, d.s5,
                                       d.s6, d.s6, d.s7, d.s7);
        }
        vstore16(sum, 0, to + 2 * n);
    }
    for (; n < PITCH; n += 8) vstore16((float16)(0.0f), 0, to + 2 * n);
}
