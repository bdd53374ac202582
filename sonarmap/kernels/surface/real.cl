// Double precision where the device has it: the information on a pose may differ by a factor of 1e9 between directions.
#ifndef RECORD
#if FP64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
typedef double8 real8;
#define convert_real8 convert_double8
#else
typedef float real;
typedef float8 real8;
#define convert_real8 convert_float8
#endif
// The record of a pose: its state (9 numbers of the rotation, 3 of the shift, the width, which is the median gap
// between the surfaces, and 2 stretches); the sums of a step (3 matrices 8 x 8, a gradient, the total weight and the
// weighted squared gaps); 6 axes of 8 numbers, as in solve.cl; 8 doubts, 6 of them used; the state after the last
// step; the residuals of instruments, 0 beyond their number; and the step by the pairs alone.
#define SHIFT 9
#define WIDTH 12
#define STRETCH 13
#define SUMS 16
#define AXES 224
#define DOUBTS 272
#define NEXT 280
#define OFF 296
#define ALONE 302
#define RECORD 308
#define STATE 15
// Offsets among the sums.
#define SUMS_COUNT 208
#define WHOLE 64
#define SHARED 128
#define GRADIENT 192
#define TOTAL 200
#define SQUARES 201
// The measurements by instruments: the residuals at first (6), their derivatives by the step (6 x 6, in rows), the
// covariance of errors that all points of a scan share, the shortest step for each residual (6 x 6, in columns), and
// the chi-squared values from which and up to which scans that contradict the instruments get less weight.
#define JACOBIAN 6
#define SYSTEMATIC 42
#define SHORTEST 78
#define LIMITS 114
#define TERM 116

static float16 pose_of(__global const real* const record) {
    return (float16)(record[0], record[1], record[2], record[9], record[3], record[4], record[5], record[10], record[6], record[7],
                     record[8], record[11], 0.0f, 0.0f, 0.0f, 0.0f);
}
#endif
