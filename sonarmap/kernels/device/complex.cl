// Load and store interleaved complex numbers as vectors of 8 or 16 lanes, with separate real and imaginary parts.
//
// load_columns8 and store_columns8 take 8 adjacent complex numbers of one row. Their lanes are in the order
// 0 1 4 5 2 3 6 7: that needs one shuffle per part, and columns are independent. Those of 16 keep the order.
// transpose turns 8 rows into 8 lanes: row r of its argument holds 4 adjacent complex numbers of row r of memory, and
// afterwards rows 2 j and 2 j + 1 hold the real and imaginary parts of number j. Pointers need a float's alignment.

static inline float8 shuffle_low(const float8 a, const float8 b) {
    return (float8)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
}

static inline float8 shuffle_high(const float8 a, const float8 b) {
    return (float8)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
}

static inline void load_columns8(__global const float* from, float8* re, float8* im) {
    const float8 a = vload8(0, from), b = vload8(1, from);
    *re = (float8)(a.s0, a.s2, b.s0, b.s2, a.s4, a.s6, b.s4, b.s6);
    *im = (float8)(a.s1, a.s3, b.s1, b.s3, a.s5, a.s7, b.s5, b.s7);
}

static inline void store_columns8(__global float* to, const float8 re, const float8 im) {
    vstore8(shuffle_low(re, im), 0, to);
    vstore8(shuffle_high(re, im), 1, to);
}

static inline void load_columns16(__global const float* from, float16* re, float16* im) {
    const float16 a = vload16(0, from), b = vload16(1, from);
    *re = (float16)(a.even, b.even);
    *im = (float16)(a.odd, b.odd);
}

static inline void store_columns16(__global float* to, const float16 re, const float16 im) {
    float16 a, b;
    a.even = re.lo;
    a.odd = im.lo;
    b.even = re.hi;
    b.odd = im.hi;
    vstore16(a, 0, to);
    vstore16(b, 1, to);
}

static inline void transpose(float8* t) {
    const float8 a0 = shuffle_low(t[0], t[1]), a1 = shuffle_high(t[0], t[1]);
    const float8 a2 = shuffle_low(t[2], t[3]), a3 = shuffle_high(t[2], t[3]);
    const float8 a4 = shuffle_low(t[4], t[5]), a5 = shuffle_high(t[4], t[5]);
    const float8 a6 = shuffle_low(t[6], t[7]), a7 = shuffle_high(t[6], t[7]);
    const float8 b0 = (float8)(a0.s01, a2.s01, a0.s45, a2.s45), b1 = (float8)(a0.s23, a2.s23, a0.s67, a2.s67);
    const float8 b2 = (float8)(a1.s01, a3.s01, a1.s45, a3.s45), b3 = (float8)(a1.s23, a3.s23, a1.s67, a3.s67);
    const float8 b4 = (float8)(a4.s01, a6.s01, a4.s45, a6.s45), b5 = (float8)(a4.s23, a6.s23, a4.s67, a6.s67);
    const float8 b6 = (float8)(a5.s01, a7.s01, a5.s45, a7.s45), b7 = (float8)(a5.s23, a7.s23, a5.s67, a7.s67);
    t[0] = (float8)(b0.lo, b4.lo);
    t[1] = (float8)(b1.lo, b5.lo);
    t[2] = (float8)(b2.lo, b6.lo);
    t[3] = (float8)(b3.lo, b7.lo);
    t[4] = (float8)(b0.hi, b4.hi);
    t[5] = (float8)(b1.hi, b5.hi);
    t[6] = (float8)(b2.hi, b6.hi);
    t[7] = (float8)(b3.hi, b7.hi);
}

// Load and store 4 complex numbers of 8 rows, `pitch` floats apart, as lanes. Loops would keep t in memory.
static inline void load_rows(__global const float* from, const int pitch, float8* t) {
    t[0] = vload8(0, from);
    t[1] = vload8(0, from + pitch);
    t[2] = vload8(0, from + 2 * pitch);
    t[3] = vload8(0, from + 3 * pitch);
    t[4] = vload8(0, from + 4 * pitch);
    t[5] = vload8(0, from + 5 * pitch);
    t[6] = vload8(0, from + 6 * pitch);
    t[7] = vload8(0, from + 7 * pitch);
    transpose(t);
}

static inline void store_rows(__global float* to, const int pitch, float8* t) {
    transpose(t);
    vstore8(t[0], 0, to);
    vstore8(t[1], 0, to + pitch);
    vstore8(t[2], 0, to + 2 * pitch);
    vstore8(t[3], 0, to + 3 * pitch);
    vstore8(t[4], 0, to + 4 * pitch);
    vstore8(t[5], 0, to + 5 * pitch);
    vstore8(t[6], 0, to + 6 * pitch);
    vstore8(t[7], 0, to + 7 * pitch);
}
