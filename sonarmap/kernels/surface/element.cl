// A point of a surface, with what is known of it: 12 float32.
//
// s012 the point, s3 whether it has neighbors on all sides (1) or lies at a rim (0), s456 the unit normal, of either
// sign, s7 the number of the direction that the normal is nearest to, s89a the ray to the point from where it was seen,
// 0 where that is not known, sb unused.
typedef struct {
    float4 point;
    float4 normal;
    float4 ray;
} Element;

static Element element(__global const float4* const restrict elements, const int n) {
    return (Element){elements[3 * n], elements[3 * n + 1], elements[3 * n + 2]};
}

// A point moved by the rows of [R | t], a vector by R, a point back, and a vector back by the inverse.
static float3 turned(const float16 T, const float3 v) {
    return (float3)(dot(T.s012, v), dot(T.s456, v), dot(T.s89a, v));
}

static float3 turned_back(const float16 T, const float3 v) { return T.s012 * v.x + T.s456 * v.y + T.s89a * v.z; }

static float3 shift_of(const float16 T) { return T.s37b; }
