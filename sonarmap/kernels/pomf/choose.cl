// Select the highest peaks of correlations: find a threshold, collect the local maxima above it, choose the highest.
//
// Layout: values (C, edge, edge, edge) float32 are the correlations, correlation c of pose first + c % count.
// poses (n, 20) float32: numbers 16..18 are the reaches, the largest cyclic distance of a peak from 0 along each axis.
// tops (C, edge, edge): the maximum of each row within the reach along it. energies (C, parts + 1): partial sums of
// |X|^2 over the whole spectrum, then X at frequency 0.
// states (C, 4): threshold, mean, standard deviation, and the number of local maxima (an int). maxima (C, CAPACITY, 28)
// int32: index, then the bits of the 27 values around it. out (poses, C / count, 4 + 28 * wanted) int32: the number of
// chosen peaks, or -1 if they may be incomplete; the bits of mean and deviation; the number of local maxima; then the
// peaks as in maxima, highest first.
#ifndef WIDTH
#define WIDTH 1  // work-items of a group
#endif
#ifndef ROWS
#define ROWS 1  // rows that a work-item searches
#endif
#define CAPACITY 256
#define RECORD 28
#define BINS 1024
#define BINS_PER_DEVIATION 16.0f

static bool beyond(const int row, const int edge, const float4 reach) {
    const int i = row / edge, j = row % edge;
    return min(i, edge - i) > reach.x || min(j, edge - j) > reach.y;
}

// The maximum of each row within the reach along it, if no transform has stored it; one group of WIDTH per row.
__kernel __attribute__((reqd_work_group_size(WIDTH, 1, 1)))
void row_maxima(__global const float* const restrict values, __global float* const restrict tops,
                __global const float* const restrict poses, const int count, const int first, const int edge) {
    __local float found[WIDTH];
    const int item = get_local_id(0);
    const size_t row = get_group_id(0);
    const float reach = poses[(first + row / (edge * edge) % count) * 20 + 18];
    float top = -INFINITY;
    for (int k = item; k < edge; k += WIDTH)
        if (min(k, edge - k) <= reach) top = max(top, values[row * edge + k]);
    found[item] = top;
    for (int part = WIDTH / 2; part; part /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < part) found[item] = max(found[item], found[item + part]);
    }
    if (!item) tops[row] = found[0];
}

// A threshold that about `wanted` rows or more reach, by a histogram of their maxima; one group per correlation.
__kernel __attribute__((reqd_work_group_size(WIDTH, 1, 1)))
void threshold(__global const float* const restrict tops, __global const float* const restrict energies,
               __global const float* const restrict poses, __global float* restrict states, const int parts,
               const int wanted, const int count, const int first, const int edge) {
    __local int bins[BINS];
    __local float sums[WIDTH];
    const int item = get_local_id(0), c = get_group_id(0);
    __global const float* const energy = energies + (size_t)c * (parts + 1);
    float sum = 0.0f;
    for (int p = item; p < parts; p += WIDTH) sum += energy[p];
    sums[item] = sum;
    for (int b = item; b < BINS; b += WIDTH) bins[b] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int part = WIDTH / 2; part; part /= 2) {
        if (item < part) sums[item] += sums[item + part];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const float size = (float)edge * edge * edge, mean = energy[parts] / size;
    const float variance = sums[0] / size / size - mean * mean;
    const float deviation = variance > 0.0f ? sqrt(variance) : variance - variance;  // NaN stays NaN
    const float scale = deviation > 0.0f ? BINS_PER_DEVIATION / deviation : 0.0f;
    const float4 reach = vload4(4, poses + (first + c % count) * 20);
    __global const float* const top = tops + (size_t)c * (edge * edge);
    for (int r = item; r < edge * edge; r += WIDTH) {
        if (beyond(r, edge, reach)) continue;
        const int b = clamp((int)((top[r] - mean) * scale), 0, BINS - 1);
#if WIDTH == 1
        ++bins[b];
#else
        atomic_inc(bins + b);
#endif
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item) return;
    int b = BINS - 1;
    for (int above = bins[b]; b && above < wanted; above += bins[b]) --b;
    states += 4 * c;
    states[0] = b ? mean + b * deviation / BINS_PER_DEVIATION : -INFINITY;
    states[1] = mean;
    states[2] = deviation;
    states[3] = as_float(0);
}

// Local maxima, which none of 26 cyclic neighbors exceeds, not below the threshold; a work-item per ROWS rows.
__kernel void collect(__global const float* restrict values, __global const float* restrict tops,
                      __global const float* const restrict poses, __global float* const restrict states,
                      __global int* const restrict maxima, const int count, const int first, const int edge) {
    const int c = get_global_id(1);
    const float4 reach = vload4(4, poses + (first + c % count) * 20);
    const float least = states[4 * c];
    values += (size_t)c * (edge * edge) * edge;
    tops += (size_t)c * (edge * edge);
    const int begin = get_global_id(0) * ROWS, end = min(begin + ROWS, edge * edge);
    for (int r = begin; r < end; ++r) {
        if (!(tops[r] >= least) || beyond(r, edge, reach)) continue;
        const int i = r / edge, j = r % edge;
        __global const float* const row = values + (size_t)r * edge;
        for (int k = 0; k < edge; ++k) {
            const float value = row[k];
            if (!(value >= least) || min(k, edge - k) > reach.z) continue;
            if (row[k ? k - 1 : edge - 1] > value || row[k < edge - 1 ? k + 1 : 0] > value) continue;  // most end here
            float cube[27];
            bool highest = true;
            for (int n = 0; n < 27 && highest; ++n) {
                const int a = (i + n / 9 + edge - 1) % edge, b = (j + n / 3 % 3 + edge - 1) % edge;
                cube[n] = values[((size_t)a * edge + b) * edge + (k + n % 3 + edge - 1) % edge];
                highest = cube[n] <= value;
            }
            if (!highest) continue;
            const int slot = atomic_inc((__global int*)states + 4 * c + 3);
            if (slot >= CAPACITY) continue;
            __global int* const to = maxima + ((size_t)c * CAPACITY + slot) * RECORD;
            to[0] = r * edge + k;
            for (int n = 0; n < 27; ++n) to[1 + n] = as_int(cube[n]);
        }
    }
}

static int apart(const int a, const int b, const int n) {
    return min(abs(a - b), n - abs(a - b));
}

// The highest separated local maxima; of equal ones the first voxel comes first. One work-item per correlation.
__kernel void choose(__global const float* const restrict states, __global int* restrict maxima,
                     __global int* restrict out, const int wanted, const float separation,
                     const int count, const int first, const int edge) {
    const int c = get_global_id(0), exponents = get_global_size(0) / count;
    maxima += (size_t)c * CAPACITY * RECORD;
    out += ((size_t)(first + c % count) * exponents + c / count) * (4 + RECORD * wanted);
    const int total = as_int(states[4 * c + 3]), known = min(total, CAPACITY);
    int chosen = 0;
    for (; chosen < wanted; ++chosen) {
        int best = -1, place = 0;
        float height = -INFINITY;
        for (int n = 0; n < known; ++n) {
            const int index = maxima[n * RECORD];
            const float value = as_float(maxima[n * RECORD + 14]);
            if (index < 0 || value < height || (value == height && best >= 0 && index > place)) continue;
            best = n;
            place = index;
            height = value;
        }
        if (best < 0) break;
        for (int k = 0; k < RECORD; ++k) out[4 + chosen * RECORD + k] = maxima[best * RECORD + k];
        const int i = place / (edge * edge), j = place / edge % edge, k = place % edge;
        for (int n = 0; n < known; ++n) {
            const int index = maxima[n * RECORD];
            if (index < 0) continue;
            const int far = max(max(apart(index / (edge * edge), i, edge),
                                    apart(index / edge % edge, j, edge)), apart(index % edge, k, edge));
            if (!(far > separation)) maxima[n * RECORD] = -1;
        }
    }
    const bool complete = total <= CAPACITY && (chosen == wanted || states[4 * c] == -INFINITY);
    out[0] = complete ? chosen : -1;
    out[1] = as_int(states[4 * c + 1]);
    out[2] = as_int(states[4 * c + 2]);
    out[3] = total;
}
