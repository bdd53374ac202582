// Sums over pairs of points: the normal equations of a point-to-plane step, and how well the planes constrain a pose.
//
// Layout: rows (k, count) float16 as in pairs.cl; records (k, RECORD) and sums (k, parts, SUMS_COUNT) as in real.cl:
// the matrix of the pairs that move the pose, of all pairs, and of all with one scan's normals times the other's; the
// gradient of those that move it, the total weight, and the sum of the weighted squared gaps. The derivative of a gap
// has 8 parts: by turn, by shift, by the stretches of both scans. The weights are those of Geman and McClure.
#include "surface/real.cl"
#ifndef LANES
#define LANES 1
#endif
#ifndef PART
#define PART 128
#endif

typedef struct {
    float8 ours;    // the gap's derivative with one scan's normal
    float8 theirs;  // the same with the other scan's normal
    float gap;
    float weight;
    float moving;  // the weight if the pair moves the pose, else 0
} Pair;

static float8 derivative(const float3 arm, const float3 normal, const float2 by_stretch) {
    const float3 turn = cross(arm, normal);
    return (float8)(turn, normal, by_stretch);
}

static Pair pair_of(const float16 row, const float scale, __global const real* const record,
                    const int stretches) {
    const float2 by_stretch = stretches ? row.sbc : (float2)(0.0f);
    const float gap = row.s3 + by_stretch.x * (float)record[STRETCH] + by_stretch.y * (float)record[STRETCH + 1];
    const float ratio = gap / fmax(row.sd, 1e-30f);
    const float beside = 1.0f + ratio * ratio;
    const float weight = row.s7 > 0.0f ? scale / (beside * beside) : 0.0f;
    return (Pair){derivative(row.s456, row.s012, by_stretch), derivative(row.s456, row.s89a, by_stretch), gap, weight,
                  row.s7 > 1.0f ? weight : 0.0f};
}

#if LANES == 1
// One work-item: PART pairs of a pose.
__kernel void add_up(__global const float16* const restrict rows, __global const real* const restrict records,
                     __global real* const restrict sums, const int count, const float scale, const int stretches) {
    const int part = get_global_id(0);
    const size_t pose = get_global_id(1);
    real8 moving[8], whole[8], shared[8];
    for (int i = 0; i < 8; ++i) moving[i] = whole[i] = shared[i] = (real8)(0);
    real8 gradient = (real8)(0);
    real total = 0;
    real squares = 0;
    for (int n = part * PART; n < min((part + 1) * PART, count); ++n) {
        const float16 row = rows[pose * count + n];
        if (!(row.s7 > 0.0f)) continue;
        const Pair pair = pair_of(row, scale, records + pose * RECORD, stretches);
        const real8 ours = convert_real8(pair.ours);
        const real8 theirs = convert_real8(pair.theirs);
        real factors[8];
        vstore8(ours, 0, factors);
        for (int i = 0; i < 8; ++i) {
            const real weighted = pair.weight * factors[i];
            whole[i] += weighted * ours;
            shared[i] += weighted * theirs;
            moving[i] += pair.moving * factors[i] * ours;
        }
        gradient += (real)pair.moving * (real)pair.gap * ours;
        total += pair.weight;
        squares += (real)pair.weight * pair.gap * pair.gap;
    }
    __global real* const out = sums + (pose * get_global_size(0) + part) * SUMS_COUNT;
    for (int i = 0; i < 8; ++i) {
        vstore8(moving[i], i, out);
        vstore8(whole[i], i, out + WHOLE);
        vstore8(shared[i], i, out + SHARED);
    }
    vstore8(gradient, 0, out + GRADIENT);
    out[TOTAL] = total;
    out[SQUARES] = squares;
}
#else
// One group: PART pairs of a pose, staged in local memory; each work-item adds up one of the sums.
__kernel void add_up(__global const float16* const restrict rows, __global const real* const restrict records,
                     __global real* const restrict sums, const int count, const float scale, const int stretches) {
    __local float passing[32][20];
    const int lane = get_local_id(0);
    const int part = get_group_id(0);
    const size_t pose = get_global_id(1);
    // a product of two of a pair's numbers, times one of its weights: 0..7 ours, 8..15 theirs, 16 the gap, 17 is 1
    const int matrix = lane / 64;
    const int left = lane < GRADIENT ? lane / 8 % 8 : lane < TOTAL ? lane % 8 : lane == SQUARES ? 16 : 17;
    const int right = lane < SHARED ? lane % 8 : lane < GRADIENT ? 8 + lane % 8 : lane == TOTAL ? 17 : 16;
    const int weight = matrix == 0 || (lane >= GRADIENT && lane < TOTAL) ? 19 : 18;
    real sum = 0;
    const int end = min((part + 1) * PART, count);
    for (int first = part * PART; first < end; first += 32) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (lane < 32) {
            const int n = first + lane;
            const float16 row = n < end ? rows[pose * count + n] : (float16)(0.0f);
            const Pair pair = pair_of(row, scale, records + pose * RECORD, stretches);
            vstore8(pair.ours, 0, passing[lane]);
            vstore8(pair.theirs, 1, passing[lane]);
            vstore4((float4)(pair.gap, 1.0f, pair.weight, pair.moving), 4, passing[lane]);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int n = 0; n < 32; ++n)
            sum += (real)passing[n][weight] * (real)passing[n][left] * (real)passing[n][right];
    }
    if (lane < SUMS_COUNT) sums[(pose * get_num_groups(0) + part) * SUMS_COUNT + lane] = sum;
}
#endif

// Squares of each pair's share of the shared information, along its axes: out (k, parts, 8). One work-item: an axis
// over PART pairs.
__kernel void add_doubts(__global const float16* const restrict rows, __global const real* const restrict records,
                         __global real* const restrict out, const int count, const float scale, const int stretches) {
    const int axis = get_global_id(0) % 8;
    const int part = get_global_id(0) / 8;
    const size_t pose = get_global_id(1);
    real direction[6];
    for (int i = 0; i < 6; ++i) direction[i] = axis < 6 ? records[pose * RECORD + AXES + axis * 8 + i] : 0;
    real sum = 0;
    for (int n = part * PART; n < min((part + 1) * PART, count); ++n) {
        const float16 row = rows[pose * count + n];
        if (!(row.s7 > 0.0f)) continue;
        const Pair pair = pair_of(row, scale, records + pose * RECORD, stretches);
        const float8 a = pair.ours;
        const float8 b = pair.theirs;
        const real by_ours = a.s0 * direction[0] + a.s1 * direction[1] + a.s2 * direction[2] + a.s3 * direction[3] +
                             a.s4 * direction[4] + a.s5 * direction[5];
        const real by_theirs = b.s0 * direction[0] + b.s1 * direction[1] + b.s2 * direction[2] +
                               b.s3 * direction[3] + b.s4 * direction[4] + b.s5 * direction[5];
        const real product = pair.weight * by_ours * by_theirs;
        sum += product * product;
    }
    out[(pose * (get_global_size(0) / 8) + part) * 8 + axis] = sum;
}
