// Add up the sums of a step, solve its normal equations, and find the principal axes of the information on a pose.
//
// Layout: records (k, RECORD) as in real.cl; parts (k, parts, SUMS_COUNT or 8) from equations.cl; terms (k, TERM), the
// instruments' measurements with unit covariance, linearized about the first pose; poses (k) float16, the rows of
// [R | t] in the first 12, after the last step. A turn is a rotation in the target's axes about the source's grid
// center; see tests/kernels/surface/steps.py for the same in NumPy.
#include "surface/real.cl"
#ifndef LANES
#define LANES 1
#endif
#define DAMPING (real)1e-9
// Ratio of shared to whole information from which it is not due to noise.
#define AGREEING (real)0.3
#define UNKNOWN (real)1e6

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

// A Gauss-Newton step of a pose with opposite stretches, if there are any, whose prior has the information `held`.
static void step_alone(__global const real* const sums, const real state[STATE], const int stretches, const real held,
                       real step[6]) {
    real A[6][6];
    real b[6];
    // the mean of both stretches is not estimated: it stays
    const real common = (state[STRETCH] + state[STRETCH + 1]) / 2;
    const real apart = (state[STRETCH] - state[STRETCH + 1]) / 2;
    const real between = sums[6 * 8 + 6] - 2 * sums[6 * 8 + 7] + sums[7 * 8 + 7] + 2 * held;
    const real pull = sums[GRADIENT + 6] - sums[GRADIENT + 7] + 2 * held * apart;
    const real by_common = stretches ? common * (sums[6 * 8 + 6] - sums[7 * 8 + 7]) : 0;
    real trace = 0;
    for (int i = 0; i < 6; ++i) {
        const real across = stretches ? sums[i * 8 + 6] - sums[i * 8 + 7] : 0;
        b[i] = -sums[GRADIENT + i];
        if (stretches)
            b[i] += common * (sums[i * 8 + 6] + sums[i * 8 + 7]) + across * (pull - by_common) / between;
        for (int j = 0; j < 6; ++j)
            A[i][j] = sums[i * 8 + j] - (stretches ? across * (sums[j * 8 + 6] - sums[j * 8 + 7]) / between : 0);
        trace += A[i][i];
    }
    const real damping = DAMPING * (trace + DAMPING);
    for (int i = 0; i < 6; ++i) A[i][i] += damping;
    solve6(A, b, step, damping);
}

// Change the stretches for a step of the pose: oppositely, or each freely if instruments measured the pose.
static void stretch(__global const real* const sums, real state[STATE], const real step[6], const bool freely,
                    const real held) {
    real rest[2];
    for (int k = 0; k < 2; ++k) {
        rest[k] = sums[GRADIENT + 6 + k] + held * state[STRETCH + k];
        for (int i = 0; i < 6; ++i) rest[k] += sums[(6 + k) * 8 + i] * step[i];
    }
    const real a = sums[6 * 8 + 6] + held, b = sums[6 * 8 + 7], d = sums[7 * 8 + 7] + held;
    const real apart = (rest[0] - rest[1]) / (a - 2 * b + d), determinant = a * d - b * b;
    state[STRETCH] -= freely ? (d * rest[0] - b * rest[1]) / determinant : apart;
    state[STRETCH + 1] -= freely ? (a * rest[1] - b * rest[0]) / determinant : -apart;
}

// Eigenvectors of a symmetric matrix in the rows of V, by Jacobi's method; A keeps the eigenvalues on its diagonal.
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
                    const real v = V[p][k];
                    V[p][k] = c * v - s * V[q][k];
                    V[q][k] = s * v + c * V[q][k];
                }
            }
        }
    }
}

// The symmetric part of a matrix 8 x 8 with the stretches, of the information `held`, eliminated: the Schur complement.
static void of_pose(__global const real* const sums, const int stretches, const real held, real A[6][6]) {
    const real a = sums[6 * 8 + 6] + held, b = (sums[6 * 8 + 7] + sums[7 * 8 + 6]) / 2, d = sums[7 * 8 + 7] + held;
    real first[6], second[6];
    for (int i = 0; i < 6; ++i) {
        first[i] = (sums[i * 8 + 6] + sums[6 * 8 + i]) / 2;
        second[i] = (sums[i * 8 + 7] + sums[7 * 8 + i]) / 2;
    }
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 6; ++j) {
            A[i][j] = (sums[i * 8 + j] + sums[j * 8 + i]) / 2;
            if (stretches)
                A[i][j] -= (d * first[i] * first[j] - b * (first[i] * second[j] + second[i] * first[j]) +
                            a * second[i] * second[j]) / (a * d - b * b);
        }
    }
}

// A B, or A times the transpose of B.
static void product(real A[6][6], real B[6][6], const bool transposed, real out[6][6]) {
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) {
            out[i][j] = 0;
            for (int k = 0; k < 6; ++k) out[i][j] += A[i][k] * (transposed ? B[j][k] : B[k][j]);
        }
}

// Rows whose outer products sum up to the covariance of the pose by the planes, without rare large errors, but larger in
// directions that noise alone seems to constrain; `variance` is that of the gaps, and `usual` its share without these
// errors.
static void planes_root(__global const real* const sums, const int stretches, const real held, const real variance,
                        const real usual, real root[6][6]) {
    real A[6][6], V[6][6], W[6][6], B[6][6];
    of_pose(sums + WHOLE, stretches, held, A);
    real trace = 0;
    for (int i = 0; i < 6; ++i) trace += A[i][i];
    const real damping = DAMPING * (trace + DAMPING);
    for (int i = 0; i < 6; ++i) A[i][i] += damping;
    eigenvectors6(A, V);
    for (int k = 0; k < 6; ++k)
        for (int i = 0; i < 6; ++i) W[k][i] = V[k][i] / sqrt(fmax(A[k][k], damping));
    of_pose(sums + SHARED, stretches, held, A);
    product(W, A, false, B);
    product(B, W, true, A);
    eigenvectors6(A, V);
    product(V, W, false, root);
    for (int k = 0; k < 6; ++k) {
        const real doubt = clamp(usual * AGREEING / fmax(A[k][k], (real)1e-9), usual, (real)1);
        for (int i = 0; i < 6; ++i) root[k][i] *= sqrt(variance * doubt);
    }
}

// Change the step by the pairs alone to that by pairs and instruments, whose residuals are `off`, by the Kalman gain. If
// the pose by the pairs deviates from the measurement by more than the first of `LIMITS`, their covariance grows
// along the shortest step that explains this, which changes the gain by the formula of Sherman and Morrison.
static void combine(real root[6][6], __global const real* const off, __global const real* const term, real step[6]) {
    real covariance[6][6], J[6][6], JC[6][6], together[6][6], there[6], x[6];
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) {
            J[i][j] = term[JACOBIAN + i * 6 + j];
            covariance[i][j] = term[SYSTEMATIC + i * 6 + j];
            for (int k = 0; k < 6; ++k) covariance[i][j] += root[k][i] * root[k][j];
        }
    product(J, covariance, false, JC);
    product(JC, J, true, together);
    for (int i = 0; i < 6; ++i) {
        together[i][i] += 1;
        there[i] = off[i];
        for (int j = 0; j < 6; ++j) there[i] += J[i][j] * step[j];
    }
    solve6(together, there, x, 1);
    real squared = 0;
    for (int i = 0; i < 6; ++i) squared += there[i] * x[i];
    const real lower = term[LIMITS], upper = term[LIMITS + 1];
    const real factor = fmax(squared - lower, (real)0) / fmax(upper - squared, upper / UNKNOWN);
    const real added = factor * squared / fmax(squared, lower);
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j)
            step[i] -= (JC[j][i] * x[j] + added * term[SHORTEST + i * 6 + j] * there[j]) / (1 + added);
}

// The principal axes of the shared information, ascending, each followed by its share of the information of a pair and
// by the rest of the whole information of a pair along it; they are found for turns times the lever arm, which the axes'
// turns are divided by. As `principal_axes` of spectral/verify/fit.py.
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
        real rest = 0;
        for (int k = 0; k < 6; ++k) V[i][k] /= k < 3 ? lever : 1;
        for (int k = 0; k < 6; ++k) {
            axes[rank * 8 + k] = V[i][k];
            for (int j = 0; j < 6; ++j)
                rest += V[i][k] * V[i][j] * (sums[WHOLE + k * 8 + j] - sums[SHARED + k * 8 + j]) / total;
        }
        axes[rank * 8 + 6] = A[i][i];
        axes[rank * 8 + 7] = rest;
    }
}

// One group: a pose. With `steps` it moves; otherwise its next state and its principal axes are stored. The variance of
// the gaps is scale * width^power, and that of a stretch `stretched`.
__kernel void solve(__global const real* const restrict parts, __global real* const restrict records,
                    __global const real* const restrict terms, __global float16* const restrict poses, const int count,
                    const int steps, const int measured, const int stretches, const real scale, const real power,
                    const real narrowest, const real stretched, const real usual) {
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
    real state[STATE], step[6], root[6][6];
    for (int i = 0; i < STATE; ++i) state[i] = record[i];
    const real variance = scale * pow(fmax(state[WIDTH], narrowest), power);
    const real held = stretches ? variance / stretched : 0;
    step_alone(record + SUMS, state, stretches, held, step);
    for (int i = 0; i < 6; ++i) record[ALONE + i] = step[i];
    if (measured) {
        planes_root(record + SUMS, stretches, held, variance, usual, root);
        combine(root, record + OFF, terms + pose * TERM, step);
    }
    if (stretches) stretch(record + SUMS, state, step, measured, held);
    move(state, step);
    __global real* const next = steps ? record : record + NEXT;
    for (int i = 0; i < STATE; ++i) next[i] = state[i];
    if (!steps) {
        poses[pose] = pose_of(next);
        principal_axes(record + SUMS, record + AXES);
        return;
    }
    for (int i = 0; measured && i < 6; ++i)
        for (int j = 0; j < 6; ++j) record[OFF + i] += terms[pose * TERM + JACOBIAN + i * 6 + j] * step[j];
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
