// Add up the sums of a step, solve its normal equations, and find the principal axes of the information on a pose.
//
// Layout: records (k, RECORD) as in real.cl; parts (k, parts, SUMS_COUNT or 8) from equations.cl; poses (k) float16,
// the rows of [R | t] in the first 12, after the last step. A turn is a rotation in the target's axes about the
// source's grid center; see tests/kernels/surface/steps.py for the same in NumPy.
#include "surface/real.cl"
#ifndef LANES
#define LANES 1
#endif
#define DAMPING (real)1e-9

// Solve the symmetric A x = b by L D L^T; A is overwritten. In an unconstrained direction rounding may leave a pivot
// below `least`, the damping, which then takes its place.
static void solve6(real A[6][6], const real b[6], real x[6], const real least) {
    for (int j = 0; j < 6; ++j) {
        real pivot = A[j][j];
        for (int k = 0; k < j; ++k) pivot -= A[j][k] * A[j][k] * A[k][k];
        A[j][j] = fmax(pivot, least);
        for (int i = j + 1; i < 6; ++i) {
            real v = A[i][j];
            for (int k = 0; k < j; ++k) v -= A[i][k] * A[j][k] * A[k][k];
            A[i][j] = v / A[j][j];
        }
    }
    for (int i = 0; i < 6; ++i) {
        x[i] = b[i];
        for (int k = 0; k < i; ++k) x[i] -= A[i][k] * x[k];
    }
    for (int i = 0; i < 6; ++i) x[i] /= A[i][i];
    for (int i = 5; i >= 0; --i)
        for (int k = i + 1; k < 6; ++k) x[i] -= A[k][i] * x[k];
}

// Apply a turn and a shift to a state.
static void move(real state[STATE], const real step[6]) {
    const real angle = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
    const real a = angle > 1e-4f ? sin(angle) / angle : 1 - angle * angle / 6;
    const real half_angle = angle / 2;
    const real b_root = half_angle > 1e-4f ? sin(half_angle) / half_angle : 1 - half_angle * half_angle / 6;
    const real b = b_root * b_root / 2;
    for (int column = 0; column < 3; ++column) {
        // Rodrigues' formula: v + a (w x v) + b w x (w x v)
        const real v[3] = {state[column], state[3 + column], state[6 + column]};
        const real u[3] = {step[1] * v[2] - step[2] * v[1], step[2] * v[0] - step[0] * v[2],
                           step[0] * v[1] - step[1] * v[0]};
        state[column] = v[0] + a * u[0] + b * (step[1] * u[2] - step[2] * u[1]);
        state[3 + column] = v[1] + a * u[1] + b * (step[2] * u[0] - step[0] * u[2]);
        state[6 + column] = v[2] + a * u[2] + b * (step[0] * u[1] - step[1] * u[0]);
    }
    for (int i = 0; i < 3; ++i) state[SHIFT + i] += step[3 + i];
}

// A Gauss-Newton step of a pose and, with `stretches`, of opposite stretches, whose prior is the variance of the gaps
// over that of a stretch: known * width^power.
static void step_alone(__global const real* const sums, real state[STATE], const int stretches,
                       const real known, const real power, const real narrowest) {
    real A[6][6];
    real b[6];
    real step[6];
    const real held = stretches ? known * pow(fmax(state[WIDTH], narrowest), power) : 0;
    // the mean of both stretches is not estimated: it stays
    const real common = (state[STRETCH] + state[STRETCH + 1]) / 2;
    const real apart = (state[STRETCH] - state[STRETCH + 1]) / 2;
    const real between = sums[6 * 8 + 6] - 2 * sums[6 * 8 + 7] + sums[7 * 8 + 7] + 2 * held;
    const real pull = sums[GRADIENT + 6] - sums[GRADIENT + 7] + 2 * held * apart;
    const real by_common = stretches ? common * (sums[6 * 8 + 6] - sums[7 * 8 + 7]) : 0;
    real across[6];
    real trace = 0;
    for (int i = 0; i < 6; ++i) across[i] = stretches ? sums[i * 8 + 6] - sums[i * 8 + 7] : 0;
    for (int i = 0; i < 6; ++i) {
        b[i] = -sums[GRADIENT + i];
        if (stretches)
            b[i] += common * (sums[i * 8 + 6] + sums[i * 8 + 7]) + across[i] * (pull - by_common) / between;
        for (int j = 0; j < 6; ++j) A[i][j] = sums[i * 8 + j] - (stretches ? across[i] * across[j] / between : 0);
        trace += A[i][i];
    }
    const real damping = DAMPING * (trace + DAMPING);
    for (int i = 0; i < 6; ++i) A[i][i] += damping;
    solve6(A, b, step, damping);
    move(state, step);
    if (!stretches) return;
    real rest = pull;
    for (int i = 0; i < 6; ++i) rest += across[i] * step[i];
    state[STRETCH] -= rest / between;
    state[STRETCH + 1] += rest / between;
}

// Eigenvectors of a symmetric matrix in the columns of V, by Jacobi's method; A keeps the eigenvalues on its diagonal.
static void eigenvectors6(real A[6][6], real V[6][6]) {
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) V[i][j] = i == j;
    for (int sweep = 0; sweep < 10; ++sweep) {
        for (int p = 0; p < 5; ++p) {
            for (int q = p + 1; q < 6; ++q) {
                if (A[p][q] == 0) continue;
                const real ratio = (A[q][q] - A[p][p]) / (2 * A[p][q]);
                if (!(fabs(ratio) < 1e18f)) continue;
                const real t = (ratio < 0 ? -1 : 1) / (fabs(ratio) + sqrt(ratio * ratio + 1));
                const real c = 1 / sqrt(t * t + 1);
                const real s = t * c;
                for (int k = 0; k < 6; ++k) {
                    const real a = A[k][p];
                    A[k][p] = c * a - s * A[k][q];
                    A[k][q] = s * a + c * A[k][q];
                }
                for (int k = 0; k < 6; ++k) {
                    const real a = A[p][k];
                    A[p][k] = c * a - s * A[q][k];
                    A[q][k] = s * a + c * A[q][k];
                    const real v = V[k][p];
                    V[k][p] = c * v - s * V[k][q];
                    V[k][q] = s * v + c * V[k][q];
                }
            }
        }
    }
}

// The principal axes of the shared information, ascending; they are found for turns times the lever arm, which the
// axes' turns are divided by. As `principal_axes` of spectral/verify/fit.py.
static void principal_axes(__global const real* const sums, __global real* const axes) {
    const real total = fmax(sums[TOTAL], (real)1e-12f);
    const real turning = sums[SHARED] + sums[SHARED + 9] + sums[SHARED + 18];
    const real lever = sqrt(fmax(turning, (real)1e-12f) / total);
    real A[6][6];
    real V[6][6];
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 6; ++j) {
            const real units = (i < 3 ? lever : 1) * (j < 3 ? lever : 1);
            A[i][j] = (sums[SHARED + i * 8 + j] + sums[SHARED + j * 8 + i]) / (2 * units * total);
        }
    }
    eigenvectors6(A, V);
    for (int i = 0; i < 6; ++i) {
        int rank = 0;
        for (int j = 0; j < 6; ++j) rank += A[j][j] < A[i][i] || (A[j][j] == A[i][i] && j < i);
        for (int k = 0; k < 6; ++k) axes[rank * 8 + k] = V[k][i] / (k < 3 ? lever : 1);
    }
}

// One group: a pose. With `steps` it moves; otherwise its next state and its principal axes are stored.
__kernel void solve(__global const real* const restrict parts, __global real* const restrict records,
                    __global float16* const restrict poses, const int count, const int steps, const int stretches,
                    const real known, const real power, const real narrowest) {
    const int lane = get_local_id(0);
    const size_t pose = get_global_id(1);
    __global real* const record = records + pose * RECORD;
    for (int i = lane; i < SUMS_COUNT; i += LANES) {
        real sum = 0;
        for (int part = 0; part < count; ++part) sum += parts[(pose * count + part) * SUMS_COUNT + i];
        record[SUMS + i] = sum;
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (lane) return;
    real state[STATE];
    for (int i = 0; i < STATE; ++i) state[i] = record[i];
    step_alone(record + SUMS, state, stretches, known, power, narrowest);
    __global real* const next = steps ? record : record + NEXT;
    for (int i = 0; i < STATE; ++i) next[i] = state[i];
    if (steps) return;
    poses[pose] = pose_of(next);
    principal_axes(record + SUMS, record + AXES);
}

// Add up the doubts. One work-item: one of the 8 of a pose.
__kernel void add_parts(__global const real* const restrict parts, __global real* const restrict records,
                        const int count) {
    const int axis = get_global_id(0);
    const size_t pose = get_global_id(1);
    real sum = 0;
    for (int part = 0; part < count; ++part) sum += parts[(pose * count + part) * 8 + axis];
    records[pose * RECORD + DOUBTS + axis] = sum;
}
