// The correlation of two functions on the sphere over all rotations: from its Fourier coefficients over SO(3) to half
// spectra of images over the first and third Euler angle, one image for each second one.
//
// Layout: wigner (degrees, betas, 2 BANDWIDTH - 1, BANDWIDTH) float32, d[l](beta) at [l / 2, beta, m + BANDWIDTH - 1,
// n] for n >= 0; products (degrees, 2 BANDWIDTH - 1, BANDWIDTH) complex64 likewise; out (images, EDGE, PITCH)
// complex64, half spectra as kernels/fft.py has them, m along axis 1 (cyclic), n along axis 2; images beyond the
// betas are left alone.
// Precondition: BANDWIDTH is a multiple of 8 and at most EDGE / 2; out is zero.
#ifndef BANDWIDTH
#define BANDWIDTH 48
#endif
#ifndef EDGE
#define EDGE 128
#endif
#define ORDERS (2 * BANDWIDTH - 1)
#define PITCH (EDGE / 2 + 8)

// One work-item: one order m of one beta.
__kernel void synthesize(__global const float* const restrict wigner, __global const float* const restrict products,
                         __global float* const restrict out, const int betas) {
    const int row = get_global_id(0);
    const int beta = get_global_id(1);
    const int order = row - (BANDWIDTH - 1);
    const int least = abs(order);
    __global float* const to = out + 2 * ((size_t)beta * EDGE + (order + EDGE) % EDGE) * PITCH;
    for (int n = 0; n < BANDWIDTH; n += 8) {
        float16 sum = 0.0f;
        for (int pair = max((least + 1) / 2, n / 2); pair < BANDWIDTH / 2; ++pair) {
            const size_t at = (size_t)pair * ORDERS + row;
            const float8 d = vload8(0, wigner + (((size_t)pair * betas + beta) * ORDERS + row) * BANDWIDTH + n);
            const float16 product = vload16(0, products + 2 * (at * BANDWIDTH + n));
            sum.even += d * product.even;
            sum.odd += d * product.odd;
        }
        vstore16(sum, 0, to + 2 * n);
    }
}
