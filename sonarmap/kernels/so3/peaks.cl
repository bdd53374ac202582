// Local maxima of correlations over all rotations, with the values around them.
//
// Layout: values (PARTS, images, EDGE, EDGE) float32; each part's last image is 0. A voxel is a local maximum if none
// of its 26 cyclic neighbors exceeds it; of each EDGE / 4 voxels along a row only the highest one is kept, of equal
// ones the first. out (1 + slots, PARTS, 32) float32: the first number of [0, part] is the part's count, as int32; from
// [1, part] on come its maxima in any order: value, image, row, column, then the 27 values around it in C order, where
// the first and the last image of rotations repeat beyond their ends.
// Precondition: the counts are 0, EDGE is a multiple of 16, and there is a slot for each EDGE / 4 voxels.
#ifndef EDGE
#define EDGE 128
#endif
#define SEGMENT (EDGE / 4)

static void keep(__global const float* const restrict values, __global float* const restrict out, const int part,
                 const int parts, const int images, const int b, const int i, const int j) {
    const int slot = 1 + atomic_inc((__global int*)out + 32 * part);
    __global float* const to = out + ((size_t)slot * parts + part) * 32;
    __global const float* const from = values + (size_t)part * images * EDGE * EDGE;
    to[0] = from[((size_t)b * EDGE + i) * EDGE + j];
    to[1] = b;
    to[2] = i;
    to[3] = j;
    for (int n = 0; n < 27; ++n) {
        const int image = clamp(b + n / 9 - 1, 0, images - 2);
        const int row = (i + n / 3 % 3 + EDGE - 1) % EDGE;
        const int column = (j + n % 3 + EDGE - 1) % EDGE;
        to[4 + n] = from[((size_t)image * EDGE + row) * EDGE + column];
    }
}

#ifndef GPU
// Elementwise maximum of row i of three images, with the last column before the first and the first behind the last.
static void highest_of_images(__global const float* const restrict below, __global const float* const restrict image,
                              __global const float* const restrict above, const int i, float* const to) {
    const int row = i % EDGE * EDGE;
    for (int k = row; k < row + EDGE; k += 8)
        vstore8(fmax(fmax(vload8(0, below + k), vload8(0, above + k)), vload8(0, image + k)), 0, to + 1 + k - row);
    to[0] = to[EDGE];
    to[EDGE + 1] = to[1];
}

// One work-item: one image of one part.
__kernel void local_maxima(__global const float* const restrict values, __global float* const restrict out,
                           const int images) {
    const int b = get_global_id(0);
    const int part = get_global_id(1);
    __global const float* const first = values + (size_t)part * images * EDGE * EDGE;
    __global const float* const image = first + (size_t)b * EDGE * EDGE;
    __global const float* const below = first + (size_t)((b + images - 1) % images) * EDGE * EDGE;
    __global const float* const above = first + (size_t)((b + 1) % images) * EDGE * EDGE;
    float rows[3][EDGE + 2];
    highest_of_images(below, image, above, EDGE - 1, rows[2]);
    highest_of_images(below, image, above, 0, rows[0]);
    for (int i = 0; i < EDGE; ++i) {
        highest_of_images(below, image, above, i + 1, rows[(i + 1) % 3]);
        float tops[4] = {-INFINITY, -INFINITY, -INFINITY, -INFINITY};
        int columns[4];
        for (int k = 0; k < EDGE; k += 8) {
            float8 highest = -INFINITY;
            for (int n = 0; n < 3; ++n) {
                const float8 beside = fmax(vload8(0, rows[n] + k), vload8(0, rows[n] + k + 2));
                highest = fmax(highest, fmax(beside, vload8(0, rows[n] + k + 1)));
            }
            if (!any(vload8(0, image + i * EDGE + k) >= highest)) continue;
            float around[8];
            vstore8(highest, 0, around);
            for (int n = 0; n < 8; ++n) {
                const float value = image[i * EDGE + k + n];
                const int segment = (k + n) / SEGMENT;
                if (value < around[n] || value <= tops[segment]) continue;
                tops[segment] = value;
                columns[segment] = k + n;
            }
        }
        for (int segment = 0; segment < 4; ++segment)
            if (tops[segment] > -INFINITY)
                keep(values, out, part, get_global_size(1), images, b, i, columns[segment]);
    }
}
#else
// One work-group of SEGMENT work-items: a segment of a row.
__kernel __attribute__((reqd_work_group_size(SEGMENT, 1, 1))) void local_maxima(
    __global const float* const restrict values, __global float* const restrict out, const int images) {
    __local float tops[SEGMENT];
    __local int columns[SEGMENT];
    const int item = get_local_id(0);
    const int j = get_global_id(0) % EDGE;
    const int i = get_global_id(0) / EDGE;
    const int b = get_global_id(1);
    const int part = get_global_id(2);
    __global const float* const first = values + (size_t)part * images * EDGE * EDGE;
    const float value = first[((size_t)b * EDGE + i) * EDGE + j];
    bool highest = true;
    for (int n = 0; n < 27; ++n) {
        const int image = (b + n / 9 + images - 1) % images;
        const int row = (i + n / 3 % 3 + EDGE - 1) % EDGE;
        const int column = (j + n % 3 + EDGE - 1) % EDGE;
        highest = highest && value >= first[((size_t)image * EDGE + row) * EDGE + column];
    }
    tops[item] = highest ? value : -INFINITY;
    columns[item] = j;
    for (int half_group = SEGMENT / 2; half_group > 0; half_group /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        const int other = item + half_group;
        if (item < half_group &&
            (tops[other] > tops[item] || (tops[other] == tops[item] && columns[other] < columns[item]))) {
            tops[item] = tops[other];
            columns[item] = columns[other];
        }
    }
    if (item == 0 && tops[0] > -INFINITY) keep(values, out, part, get_global_size(2), images, b, i, columns[0]);
}
#endif
