// The product of a target's spectrum, a source's whitened spectrum and gains, in one pass, and its power.
//
// Layout: spectra are (n0, n1, pitch) complex64; along (n0) are gains; across (2, n1, pitch) are gains, 0 in the
// padding, then weights: how often each number occurs in the full spectrum, twice but for columns without a mirror
// image. energies get the sum of |X|^2 of each row, then the real part of X at frequency 0.
// The source is spectrum number `from`; the result is number `first` of out and of energies; out may be the source's
// array. One group of WIDTH per row.
#define LANE float
#define ALIKE int
#ifndef WIDTH
#define WIDTH 64
#endif
#include "pomf/whitening.cl"

__kernel __attribute__((reqd_work_group_size(WIDTH, 1, 1)))
void product(__global const float* spectrum, __global const float* const restrict target,
             __global float* out, __global const float* const restrict across,
             __global const float* const restrict along, __global float* restrict energies, const int n1,
             const int pitch, const float exponent, const int from, const int first) {
    __local float sums[WIDTH];
    const int item = get_local_id(0), row = get_group_id(0), rows = get_num_groups(0);
    const float outer = along[row / n1];
    energies += (size_t)first * (rows + 1);
    spectrum += (size_t)2 * from * rows * pitch;
    out += (size_t)2 * first * rows * pitch;
    float power = 0.0f;
    for (int k = item; k < pitch; k += WIDTH) {
        const size_t at = (size_t)row * pitch + k, column = row % n1 * pitch + k;
        const float2 s = vload2(at, spectrum), t = vload2(at, target);
        float re, im;
        whitened_product(t.x, t.y, s.x, s.y, outer * across[column], exponent, &re, &im);
        vstore2((float2)(re, im), at, out);
        power += (re * re + im * im) * across[n1 * pitch + column];
        if (at == 0) energies[rows] = re;
    }
    sums[item] = power;
    for (int part = WIDTH / 2; part; part /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < part) sums[item] += sums[item + part];
    }
    if (!item) energies[row] = sums[0];
}
