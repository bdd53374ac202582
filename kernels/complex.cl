// Complex numbers of 8 lanes, real and imaginary parts apart, and how they meet interleaved memory.
//
// load_columns and store_columns take 8 adjacent complex numbers of one row; their lanes are in the order
// 0 1 4 5 2 3 6 7, which costs one shuffle per part and which no column notices. transpose makes 8 lanes of 8
// rows: row r of its argument is 4 adjacent complex numbers of row r of memory, and afterwards rows 2 j and
// 2 j + 1 are the real and imaginary parts of number j. Pointers need be aligned to a float only.

inline float8 shuffle_low(const float8 a, const float8 b) {
    return (float8)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
}

inline float8 shuffle_high(const float8 a, const float8 b) {
    return (float8)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
}

inline void load_columns(__global const float* from, float8* re, float8* im) {
    const float8 a = vload8(0, from), b = vload8(1, from);
    *re = (float8)(a.s0, a.s2, b.s0, b.s2, a.s4, a.s6, b.s4, b.s6);
    *im = (float8)(a.s1, a.s3, b.s1, b.s3, a.s5, a.s7, b.s5, b.s7);
}

inline void store_columns(__global float* to, const float8 re, const float8 im) {
    vstore8(shuffle_low(re, im), 0, to);
    vstore8(shuffle_high(re, im), 1, to);
}

inline void transpose(float8* t) {
    float8 u[8];
    for (int i = 0; i < 4; ++i) {
        u[2 * i] = shuffle_low(t[2 * i], t[2 * i + 1]);
        u[2 * i + 1] = shuffle_high(t[2 * i], t[2 * i + 1]);
    }
    for (int i = 0; i < 2; ++i) {
        const float8 a = u[4 * i], b = u[4 * i + 1], c = u[4 * i + 2], d = u[4 * i + 3];
        t[4 * i] = (float8)(a.s01, c.s01, a.s45, c.s45);
        t[4 * i + 1] = (float8)(a.s23, c.s23, a.s67, c.s67);
        t[4 * i + 2] = (float8)(b.s01, d.s01, b.s45, d.s45);
        t[4 * i + 3] = (float8)(b.s23, d.s23, b.s67, d.s67);
    }
    for (int i = 0; i < 4; ++i) {
        const float8 a = t[i], b = t[i + 4];
        t[i] = (float8)(a.lo, b.lo);
        t[i + 4] = (float8)(a.hi, b.hi);
    }
}

// 4 complex numbers of 8 rows, `pitch` floats apart, to and from lanes.
inline void load_rows(__global const float* from, const int pitch, float8* t) {
    for (int i = 0; i < 8; ++i) t[i] = vload8(0, from + i * pitch);
    transpose(t);
}

inline void store_rows(__global float* to, const int pitch, float8* t) {
    transpose(t);
    for (int i = 0; i < 8; ++i) vstore8(t[i], 0, to + i * pitch);
}
