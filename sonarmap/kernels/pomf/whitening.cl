// What whitening multiplies a frequency's number with: |F|^-exponent by its power |F|^2, and 0 where |F| is at most
// FLOOR, infinite or not a number.
//
// The usual exponents need no logarithm, which takes three times as long. LANE and ALIKE are the type of a real part and
// the type of its comparison: float8 and int8 where eight numbers are taken at a time, float and int elsewhere.
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

// target conj(source whitened) times a gain; what is whitened to 0 stays out of it, be it no number.
static inline void whitened_product(const LANE tr, const LANE ti, const LANE sr, const LANE si, const LANE gain,
                                    const float exponent, LANE* const re, LANE* const im) {
    const LANE scale = whitening(sr * sr + si * si, exponent);
    const LANE r = select((LANE)(0.0f), sr * scale, (ALIKE)(scale > 0.0f)) * gain;
    const LANE i = select((LANE)(0.0f), si * scale, (ALIKE)(scale > 0.0f)) * gain;
    *re = tr * r + ti * i;
    *im = ti * r - tr * i;
}
