// Row-wise reduction of a correlation, finished on the host, and a copy of chosen rows.
//
// Layout: values are rows of LENGTH float32; out is (3, rows) float32: each row's maximum, its mean, and the sum of its
// squared deviations from that mean, so that nothing is lost where the mean is large. The maximum is taken at columns
// of cyclic distance up to reach from column 0 only.
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

static int least8(const int8 v) {
    const int4 a = min(v.lo, v.hi);
    const int2 b = min(a.lo, a.hi);
    return min(b.x, b.y);
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

// One work-item per ROWS rows: the walks over a row after the first find it in the cache.
__kernel void row_statistics(__global const float* const restrict values, __global float* const restrict out,
                             const int rows, const int reach) {
    const int whole = LENGTH / 8 * 8;
    const int first = get_global_id(0) * ROWS;
    for (int r = first; r < min(first + ROWS, rows); ++r) {
        __global const float* const row = values + (size_t)r * LENGTH;
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
                          __global float* const restrict out) {
    const size_t r = get_global_id(0);
    __global const float* const from = values + (size_t)rows[r] * LENGTH;
    __global float* const to = out + r * LENGTH;
    for (int k = 0; k < LENGTH; ++k) to[k] = from[k];
}

// The highest local maximum of each segment of a row, of equal ones the first: out is (2, rows, SEGMENTS), its value and
// its column, -INFINITY and 0 where there is none, and NaN where the segment holds a number that is not finite. A voxel
// is one if none of its 26 cyclic neighbors exceeds it. One work-item per row; LENGTH is a multiple of SEGMENTS.
#ifndef SEGMENTS
#define SEGMENTS 4
#endif

// The largest values of nine rows, column by column, with the first and the last repeated cyclically around them.
static void rows_maxima(__global const float* const* const rows, float* const out) {
    const int whole = LENGTH / 8 * 8;
    for (int k = 0; k < whole; k += 8) {
        float8 top = vload8(0, rows[0] + k);
        for (int n = 1; n < 9; ++n) top = fmax(top, vload8(0, rows[n] + k));
        vstore8(top, 0, out + 1 + k);
    }
    for (int k = whole; k < LENGTH; ++k) {
        float top = rows[0][k];
        for (int n = 1; n < 9; ++n) top = fmax(top, rows[n][k]);
        out[1 + k] = top;
    }
    out[0] = out[LENGTH];
    out[LENGTH + 1] = out[1];
}

__kernel void segment_maxima(__global const float* const restrict values, __global float* const restrict out,
                             const int images, const int height) {
    const int j = get_global_id(0);
    const int i = get_global_id(1);
    __global const float* rows[9];
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
            const size_t row = (size_t)((i + a + images - 1) % images) * height + (j + b + height - 1) % height;
            rows[3 * a + b] = values + row * LENGTH;
        }
    float around[LENGTH + 2];
    rows_maxima(rows, around);
    __global const float* const row = rows[4];
    const int8 lanes = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const size_t first = ((size_t)i * height + j) * SEGMENTS;
    __global float* const columns = out + (size_t)images * height * SEGMENTS;
    for (int segment = 0; segment < SEGMENTS; ++segment) {
        const int end = (segment + 1) * (LENGTH / SEGMENTS);
        int k = segment * (LENGTH / SEGMENTS);
        float8 tops = -INFINITY;
        int8 places = LENGTH;
        int8 wrong = 0;
        for (; k + 8 <= end; k += 8) {
            const float8 v = vload8(0, row + k);
            const float8 neighbors =
                fmax(fmax(vload8(0, around + k), vload8(0, around + k + 2)), vload8(0, around + k + 1));
            const int8 better = v >= neighbors && v > tops;
            tops = select(tops, v, better);
            places = select(places, lanes + k, better);
            wrong |= !(fabs(v) < INFINITY);
        }
        float top = max8(tops);
        int column = least8(select((int8)(LENGTH), places, tops == top));
        bool finite = !any(wrong);
        for (; k < end; ++k) {
            const float v = row[k];
            finite = finite && fabs(v) < INFINITY;
            if (!(v >= fmax(fmax(around[k], around[k + 2]), around[k + 1]) && v > top)) continue;
            top = v;
            column = k;
        }
        out[first + segment] = finite ? top : NAN;
        columns[first + segment] = top > -INFINITY ? column : 0;
    }
}
