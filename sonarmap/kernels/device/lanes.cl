// Types and macros with which one kernel source serves two flavors: processors and graphics processors (GPU defined).
//
// On a processor, a work-item takes LANES = 8 adjacent numbers at a time, in an explicit vector, and loops over a whole
// row. On a graphics processor it takes one number at a time and shares the row with others; neighboring work-items
// take neighboring numbers. Kernels compute with `floatn` and loop over a row by ALONG, or by SHARED and group_sum if a
// work-group sums a row together.
// Precondition: rows are a multiple of 8 long; a summing group has a power of two of items, at most MOST_ITEMS.
#define MOST_ITEMS 256
#ifdef GPU

#define LANES 1
typedef float floatn;
typedef int intn;
#define loadn(from) (*(from))
#define storen(value, to) (*(to) = (value))
#define convert_intn convert_int
#define convert_intn_rtn convert_int_rtn
#define convert_floatn convert_float
#define ALONG(k, count) int k = get_global_id(0); k < (count); k += get_global_size(0)
#define SHARED(k, count) int k = get_local_id(0); k < (count); k += get_local_size(0)
#define EACH_LANE(F) F()
#define SCRATCH(name) __local float name[MOST_ITEMS]

static inline float lane_sum(const float v) { return v; }

static inline void load_complex(__global const float* const from, float* re, float* im) {
    const float2 v = vload2(0, from);
    *re = v.x;
    *im = v.y;
}

static inline void store_complex(const float re, const float im, __global float* const to) {
    vstore2((float2)(re, im), 0, to);
}

// The sum over the group, returned to each of its items.
static inline float group_sum(const float v, __local float* const scratch) {
    const int item = get_local_id(0);
    barrier(CLK_LOCAL_MEM_FENCE);  // all items have read the previous sum
    scratch[item] = v;
    for (int step = get_local_size(0) / 2; step > 0; step /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < step) scratch[item] += scratch[item + step];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    return scratch[0];
}

#else

#define LANES 8
typedef float8 floatn;
typedef int8 intn;
#define loadn(from) vload8(0, from)
#define storen(value, to) vstore8(value, 0, to)
#define convert_intn convert_int8
#define convert_intn_rtn convert_int8_rtn
#define convert_floatn convert_float8
#define ALONG(k, count) int k = 0; k < (count); k += LANES
#define SHARED(k, count) ALONG(k, count)
#define EACH_LANE(F) F(.s0) F(.s1) F(.s2) F(.s3) F(.s4) F(.s5) F(.s6) F(.s7)
#define SCRATCH(name)
#define group_sum(v, scratch) (v)

static inline float lane_sum(const float8 v) {
    const float4 pairs = v.lo + v.hi;
    return (pairs.x + pairs.y) + (pairs.z + pairs.w);
}

static inline void load_complex(__global const float* const from, float8* re, float8* im) {
    const float16 v = vload16(0, from);
    *re = v.even;
    *im = v.odd;
}

static inline void store_complex(const float8 re, const float8 im, __global float* const to) {
    float16 v;
    v.even = re;
    v.odd = im;
    vstore16(v, 0, to);
}

#endif
