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
