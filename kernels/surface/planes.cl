// The plane of each point's 16 nearest neighbors, itself among them, and the point moved along the normal onto it.
//
// Layout: points, starts and box as in cells.cl; directions (DIRECTIONS) float4 unit vectors, of which x, y, z count; viewpoints
// (views) float4 likewise; elements (m, 12) float32 as in element.cl, by the points' numbers.
// A point farther than `farthest` from its plane stays. One whose neighbors' middle lies farther away than the share
// `aside` of their spread is at a rim. One work-item: a point, in the order of the cells, so that neighbors are at hand.
#define KEPT 16
#include "surface/cells.cl"
#ifndef DIRECTIONS
#define DIRECTIONS 26
#endif

// One turn of Jacobi's method, which makes `off` 0 (Golub and Van Loan, Matrix Computations, sect. 8.5); the squares
// a and b, what both have with the third axis, and both axes.
static void turn_axes(float* const a, float* const b, float* const off, float* const a_third, float* const b_third,
                      float3* const axis_a, float3* const axis_b) {
    if (*off == 0.0f) return;
    const float ratio = (*b - *a) / (2.0f * *off);
    // far beyond 1e18 its square would be infinite, and the turn is nothing
    const float t = fabs(ratio) < 1e18f ? copysign(1.0f, ratio) / (fabs(ratio) + sqrt(ratio * ratio + 1.0f)) : 0.0f;
    const float c = rsqrt(t * t + 1.0f);
    const float s = t * c;
    *a -= t * *off;
    *b += t * *off;
    *off = 0.0f;
    const float third = *a_third;
    *a_third = c * third - s * *b_third;
    *b_third = s * third + c * *b_third;
    const float3 axis = *axis_a;
    *axis_a = c * axis - s * *axis_b;
    *axis_b = s * axis + c * *axis_b;
}

__kernel void planes(__global const float4* const restrict points, __global const int* const restrict starts,
                     const float8 box, __global const float4* const restrict directions,
                     __global const float4* const restrict viewpoints, __global float4* const restrict elements,
                     const int count, const int views, const float farthest, const float aside) {
    const int n = get_global_id(0);
    if (n >= count) return;
    const float3 own = points[n].xyz;
    const Kept kept = search(points, starts, box, own, INFINITY);
    int near[16];
    vstore16(kept.index, 0, near);
    const int neighbors = min(count, 16);
    float3 middle = (float3)(0.0f);
    for (int k = 0; k < neighbors; ++k) middle += points[near[k]].xyz - own;
    middle /= neighbors;
    float3 squares = (float3)(0.0f);  // xx, yy, zz
    float3 mixed = (float3)(0.0f);    // xy, xz, yz
    for (int k = 0; k < neighbors; ++k) {
        const float3 v = points[near[k]].xyz - own - middle;
        squares += v * v;
        mixed += v.xxy * v.yzz;
    }
    const float total = squares.x + squares.y + squares.z;
    float3 axis_x = (float3)(1.0f, 0.0f, 0.0f);
    float3 axis_y = (float3)(0.0f, 1.0f, 0.0f);
    float3 axis_z = (float3)(0.0f, 0.0f, 1.0f);
    float3 value = squares;
    for (int sweep = 0; sweep < 5; ++sweep) {
        float a = value.x, b = value.y, c = value.z;
        float ab = mixed.x, ac = mixed.y, bc = mixed.z;
        turn_axes(&a, &b, &ab, &ac, &bc, &axis_x, &axis_y);
        turn_axes(&a, &c, &ac, &ab, &bc, &axis_x, &axis_z);
        turn_axes(&b, &c, &bc, &ab, &ac, &axis_y, &axis_z);
        value = (float3)(a, b, c);
        mixed = (float3)(ab, ac, bc);
    }
    const bool is_x = value.x <= value.y && value.x <= value.z;
    const float least = is_x ? value.x : fmin(value.y, value.z);
    const float3 normal = normalize(is_x ? axis_x : value.y <= value.z ? axis_y : axis_z);
    const float height = dot(middle, normal);
    const float3 moved = fabs(height) > farthest ? (float3)(0.0f) : height * normal;
    const float3 off = middle - moved;
    const bool inner = dot(off, off) <= aside * aside * (total - least) / neighbors;
    int direction = 0;
    float along = -1.0f;
    for (int k = 0; k < DIRECTIONS; ++k) {
        const float here = fabs(dot(directions[k].xyz, normal));
        direction = here > along ? k : direction;
        along = fmax(here, along);
    }
    const float3 smooth = own + moved;
    float3 ray = (float3)(0.0f);
    float shortest = INFINITY;
    for (int k = 0; k < views; ++k) {
        const float3 seen = smooth - viewpoints[k].xyz;
        const float squared = dot(seen, seen);
        ray = squared < shortest ? seen : ray;
        shortest = fmin(squared, shortest);
    }
    __global float4* const out = elements + 3 * as_int(points[n].w);
    out[0] = (float4)(smooth, inner);
    out[1] = (float4)(normal, direction);
    out[2] = (float4)(ray, 0.0f);
}
