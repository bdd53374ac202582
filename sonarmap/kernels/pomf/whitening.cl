// The factor that whitens a frequency, |F|^-exponent, from its power |F|^2; 0 where |F| is at most FLOOR, infinite or
// not a number.
//
// Exponents 1 and 0.5 need no powr, which takes three times as long. LANE is the type of a real part and ALIKE that of
// its comparison: float8 and int8 for eight numbers at a time, float and int for one.
// Precondition: FLOOR^2 is a normal float.
#ifndef FLOOR
#define FLOOR 1e-9f
#endif
#ifndef LANE
#define LANE float8
#define ALIKE int8
#endif

static inline LANE whitening(const LANE power, const float exponent) {
    const LANE scale = exponent == 1.0f   ? 1.0f / sqrt(power)
                       : exponent == 0.5f ? 1.0f / sqrt(sqrt(power))
                                          : powr(power, (LANE)(-0.5f * exponent));
    return select((LANE)(0.0f), scale, (ALIKE)(power > FLOOR * FLOOR && power < INFINITY));
}

// target conj(whitened source) times a gain; a source number whose factor is 0 counts as 0, even if it is NaN.
static inline void whitened_product(const LANE tr, const LANE ti, const LANE sr, const LANE si, const LANE gain,
                                    const float exponent, LANE* const re, LANE* const im) {
    const LANE scale = whitening(sr * sr + si * si, exponent);
    const LANE r = select((LANE)(0.0f), sr * scale, (ALIKE)(scale > 0.0f)) * gain;
    const LANE i = select((LANE)(0.0f), si * scale, (ALIKE)(scale > 0.0f)) * gain;
    *re = tr * r + ti * i;
    *im = ti * r - tr * i;
}
