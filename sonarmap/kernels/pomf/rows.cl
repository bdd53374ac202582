// Statistics of a correlation's rows (the host combines them), a copy of chosen rows, and samples between voxels.
//
// Layout: values are rows of LENGTH float32, the first one `begin` floats into the buffer; out (3, rows) float32: each
// row's maximum, its mean, and the sum of its squared deviations from that mean, which keeps precision if the mean is
// large. The maximum is taken over columns of cyclic distance up to reach from column 0.
// Precondition: reach >= 0.
#ifndef LENGTH
#define LENGTH 128
#endif
#ifndef ROWS
#define ROWS 1
#endif

static float sum8(const float8 v) {
    const float4 a = v.lo + v.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}

static float max8(const float8 v) {
    const float4 a = fmax(v.lo, v.hi);
    const float2 b = fmax(a.lo, a.hi);
    return fmax(b.x, b.y);
}

// The largest value of the columns within reach of column 0, cyclically.
static float row_maximum(__global const float* const row, const int reach) {
    const int whole = LENGTH / 8 * 8;
    const int8 lanes = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    float8 tops = -INFINITY;
    if (2 * reach >= LENGTH)
        for (int k = 0; k < whole; k += 8) tops = fmax(tops, vload8(0, row + k));
    else
        for (int k = 0; k < whole; k += 8) {
            const int8 inside = lanes + k <= reach || lanes + k >= LENGTH - reach;
            tops = fmax(tops, select((float8)(-INFINITY), vload8(0, row + k), inside));
        }
    float top = max8(tops);
    for (int k = whole; k < LENGTH; ++k)
        if (k <= reach || k >= LENGTH - reach) top = fmax(top, row[k]);
    return top;
}

// One work-item per ROWS rows: passes over a row after the first find it in the cache.
__kernel void row_statistics(__global const float* const restrict values, __global float* const restrict out,
                             const int rows, const int reach, const ulong begin) {
    const int whole = LENGTH / 8 * 8;
    const int first = get_global_id(0) * ROWS;
    for (int r = first; r < min(first + ROWS, rows); ++r) {
        __global const float* const row = values + begin + (size_t)r * LENGTH;
        float8 sums = 0.0f;
        for (int k = 0; k < whole; k += 8) sums += vload8(0, row + k);
        float sum = sum8(sums);
        for (int k = whole; k < LENGTH; ++k) sum += row[k];
        const float mean = sum / LENGTH;
        float8 deviations = 0.0f;
        for (int k = 0; k < whole; k += 8) {
            const float8 d = vload8(0, row + k) - mean;
            deviations += d * d;
        }
        float deviation = sum8(deviations);
        for (int k = whole; k < LENGTH; ++k) deviation += (row[k] - mean) * (row[k] - mean);
        out[r] = row_maximum(row, reach);
        out[rows + r] = mean;
        out[2 * rows + r] = deviation;
    }
}

__kernel void gather_rows(__global const float* const restrict values, __global const int* const restrict rows,
                          __global float* const restrict out, const ulong begin) {
    const size_t r = get_global_id(0);
    __global const float* const from = values + begin + (size_t)rows[r] * LENGTH;
    __global float* const to = out + r * LENGTH;
    for (int k = 0; k < LENGTH; ++k) to[k] = from[k];
}

// Trilinear, cyclic samples (cubes, count) float32 of correlations (cubes, edge, edge, edge) at places (count, 4)
// [voxels], whose fourth number is unused. One work-item: one cube and place.
__kernel void sample(__global const float* restrict values, __global const float* const restrict places,
                     __global float* const restrict out, const int edge, const int count) {
    const int n = get_global_id(0), cube = get_global_id(1);
    values += (size_t)cube * edge * edge * edge;
    const float4 place = vload4(n, places), low = floor(place), share = place - low;
    const int4 begin = convert_int4(low);
    float sum = 0.0f;
    for (int corner = 0; corner < 8; ++corner) {
        const int4 side = (int4)(corner >> 2, corner >> 1 & 1, corner & 1, 0);
        const float4 weight = select(1.0f - share, share, side == 1);
        const int4 at = ((begin + side) % edge + edge) % edge;
        sum += weight.x * weight.y * weight.z * values[((size_t)at.x * edge + at.y) * edge + at.z];
    }
    out[(size_t)cube * count + n] = sum;
}
