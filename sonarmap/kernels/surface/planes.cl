// Fit a plane to each point's 16 nearest neighbors, itself among them, and move the point along the normal onto it.
//
// Layout: points, starts and box as in cells.cl; directions (DIRECTIONS) float4 unit vectors and viewpoints (views)
// float4, both without use of w; elements (m, 12) float32 as in cells.cl, by the points' numbers.
// A point farther than `farthest` from its plane is not moved. A point is at a rim if the mean of its neighbors is
// farther away than the share `aside` of their spread. One work-item: LANES points in the order of the cells, whose
// neighbors are close in memory; it searches for one point after the other, then fits all planes at once.
#define KEPT 16
#include "device/lanes.cl"
#include "surface/cells.cl"
#ifndef DIRECTIONS
#define DIRECTIONS 26
#endif

typedef struct {
    floatn x, y, z;
} Vector;

static inline floatn product(const Vector a, const Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Vector chosen(const Vector no, const Vector yes, const intn which) {
    return (Vector){select(no.x, yes.x, which), select(no.y, yes.y, which), select(no.z, yes.z, which)};
}

// Moments of a point's neighbors: their mean, from the point, and the sums of squares and products about the mean.
enum { X, Y, Z, MIDDLE_X, MIDDLE_Y, MIDDLE_Z, XX, YY, ZZ, XY, XZ, YZ, MOMENTS };

static void measure(__global const float4* const restrict points, __global const int* const restrict starts,
                    const float8 box, const float3 own, const int neighbors, const int lane, float* const moments) {
    const Kept kept = search(points, starts, box, own, INFINITY);
    int near[16];
    indices_of(&kept, near);
    float3 middle = (float3)(0.0f);
    for (int k = 0; k < neighbors; ++k) middle += points[near[k]].xyz - own;
    middle /= neighbors;
    float3 squares = (float3)(0.0f);
    float3 mixed = (float3)(0.0f);  // xy, xz, yz
    for (int k = 0; k < neighbors; ++k) {
        const float3 v = points[near[k]].xyz - own - middle;
        squares += v * v;
        mixed += v.xxy * v.yzz;
    }
    const float values[MOMENTS] = {own.x,     own.y,     own.z,     middle.x, middle.y, middle.z,
                                   squares.x, squares.y, squares.z, mixed.x,  mixed.y,  mixed.z};
    for (int k = 0; k < MOMENTS; ++k) moments[k * LANES + lane] = values[k];
}

// A rotation of Jacobi's method, which makes `off` 0 (Golub and Van Loan, Matrix Computations, sect. 8.5): it changes
// the diagonal elements a and b, those that both have with the third axis, and both axes.
static inline void turn_axes(floatn* const a, floatn* const b, floatn* const off, floatn* const a_third,
                             floatn* const b_third, Vector* const axis_a, Vector* const axis_b) {
    const floatn ratio = (*b - *a) / (2.0f * *off);
    // far beyond 1e18 its square would overflow, and the rotation is none; so it is where `off` is 0 already
    const floatn steep = copysign((floatn)(1.0f), ratio) / (fabs(ratio) + sqrt(ratio * ratio + 1.0f));
    const floatn t = select((floatn)(0.0f), steep, fabs(ratio) < 1e18f && *off != 0.0f);
    const floatn c = rsqrt(t * t + 1.0f);
    const floatn s = t * c;
    *a -= t * *off;
    *b += t * *off;
    *off = 0.0f;
    const floatn third = *a_third;
    *a_third = c * third - s * *b_third;
    *b_third = s * third + c * *b_third;
    const Vector axis = *axis_a;
    const Vector other = *axis_b;
    *axis_a = (Vector){c * axis.x - s * other.x, c * axis.y - s * other.y, c * axis.z - s * other.z};
    *axis_b = (Vector){s * axis.x + c * other.x, s * axis.y + c * other.y, s * axis.z + c * other.z};
}

// The axis along which the neighbors spread least, and their sum of squares along it.
static inline Vector least_axis(const float* const moments, floatn* const least) {
    floatn a = loadn(moments + XX * LANES), b = loadn(moments + YY * LANES), c = loadn(moments + ZZ * LANES);
    floatn ab = loadn(moments + XY * LANES), ac = loadn(moments + XZ * LANES), bc = loadn(moments + YZ * LANES);
    const floatn no = 0.0f, full = 1.0f;
    Vector x = {full, no, no};
    Vector y = {no, full, no};
    Vector z = {no, no, full};
    for (int sweep = 0; sweep < 5; ++sweep) {
        turn_axes(&a, &b, &ab, &ac, &bc, &x, &y);
        turn_axes(&a, &c, &ac, &ab, &bc, &x, &z);
        turn_axes(&b, &c, &bc, &ab, &ac, &y, &z);
    }
    const Vector axis = chosen(chosen(z, y, b <= c), x, a <= b && a <= c);
    const floatn scale = rsqrt(product(axis, axis));
    *least = fmin(fmin(a, b), c);
    return (Vector){axis.x * scale, axis.y * scale, axis.z * scale};
}

// The number of the direction that is nearest to the normal or its opposite.
static inline floatn nearest_direction(__global const float4* const restrict directions, const Vector normal) {
    floatn direction = 0.0f;
    floatn along = -1.0f;
    for (int k = 0; k < DIRECTIONS; ++k) {
        const float3 d = directions[k].xyz;
        const floatn here = fabs(d.x * normal.x + d.y * normal.y + d.z * normal.z);
        direction = select(direction, (floatn)(k), here > along);
        along = fmax(here, along);
    }
    return direction;
}

// The rays from the nearest viewpoint to the points; 0 without viewpoints.
static inline Vector ray_of(__global const float4* const restrict viewpoints, const int views, const Vector points) {
    const floatn no = 0.0f;
    Vector ray = {no, no, no};
    floatn shortest = INFINITY;
    for (int k = 0; k < views; ++k) {
        const float3 from = viewpoints[k].xyz;
        const Vector seen = {points.x - from.x, points.y - from.y, points.z - from.z};
        const floatn squared = product(seen, seen);
        ray = chosen(ray, seen, squared < shortest);
        shortest = fmin(squared, shortest);
    }
    return ray;
}

__kernel void planes(__global const float4* const restrict points, __global const int* const restrict starts,
                     const float8 box, __global const float4* const restrict directions,
                     __global const float4* const restrict viewpoints, __global float* const restrict elements,
                     const int count, const int views, const float farthest, const float aside) {
    const int n = LANES * get_global_id(0);
    if (n >= count) return;
    const int neighbors = min(count, 16);
    float moments[MOMENTS * LANES];
    // lanes beyond the last point repeat it
    for (int lane = 0; lane < LANES; ++lane)
        measure(points, starts, box, points[min(n + lane, count - 1)].xyz, neighbors, lane, moments);
    const Vector own = {loadn(moments + X * LANES), loadn(moments + Y * LANES), loadn(moments + Z * LANES)};
    const Vector middle = {loadn(moments + MIDDLE_X * LANES), loadn(moments + MIDDLE_Y * LANES),
                           loadn(moments + MIDDLE_Z * LANES)};
    const floatn total = loadn(moments + XX * LANES) + loadn(moments + YY * LANES) + loadn(moments + ZZ * LANES);
    floatn least;
    const Vector normal = least_axis(moments, &least);
    const floatn height = product(middle, normal);
    const floatn moved = select(height, (floatn)(0.0f), fabs(height) > farthest);
    const Vector by = {moved * normal.x, moved * normal.y, moved * normal.z};
    const Vector off = {middle.x - by.x, middle.y - by.y, middle.z - by.z};
    const intn inner = product(off, off) <= aside * aside * (total - least) / (floatn)(neighbors);
    const Vector smooth = {own.x + by.x, own.y + by.y, own.z + by.z};
    const Vector ray = ray_of(viewpoints, views, smooth);
    const floatn rows[12] = {smooth.x, smooth.y, smooth.z, select((floatn)(0.0f), (floatn)(1.0f), inner),
                             normal.x, normal.y, normal.z, nearest_direction(directions, normal),
                             ray.x,    ray.y,    ray.z,    (floatn)(0.0f)};
    float values[12 * LANES];
    for (int k = 0; k < 12; ++k) storen(rows[k], values + k * LANES);
    for (int lane = 0; lane < min(LANES, count - n); ++lane)
        for (int k = 0; k < 12; ++k) elements[12 * as_int(points[n + lane].w) + k] = values[k * LANES + lane];
}
