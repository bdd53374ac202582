// Nearest-neighbor search among points sorted into cells: ring by ring, until no cell can hold a nearer point.
//
// Layout: points (m) float4, x, y, z and the bits of the point's number (int), sorted by cell; starts (cells + 1)
// int32, where each cell's points begin; box holds the cells' origin in s012, their size in s3, and their number along
// each axis in s456. A cell's number is (x * NY + y) * NZ + z, so that a run of cells along z is a run of points.
// Points beyond the box are in the cells at its border, so that the search finds them too.
// The search keeps the indices, in `points`, of the nearest KEPT points, 1 or 16, by distance and then by index, so
// that the result does not depend on the order in which cells are visited.
#ifndef KEPT
#define KEPT 1
#endif

#if KEPT == 1
typedef struct {
    float worst;  // squared distance of the farthest kept point, or the squared reach while there are fewer
    int index;    // -1 without a point; orders as the last
} Kept;

static Kept none(const float reach) { return (Kept){reach, -1}; }

static void keep(Kept* const kept, const float squared, const int index) {
    const bool nearer = squared < kept->worst || (squared == kept->worst && (uint)index < (uint)kept->index);
    kept->worst = nearer ? squared : kept->worst;
    kept->index = nearer ? index : kept->index;
}
#else
typedef struct {
    float worst;
    float16 squared;  // ascending
    int16 index;
} Kept;

static Kept none(const float reach) { return (Kept){reach, (float16)(reach), (int16)(-1)}; }

static void indices_of(const Kept* const kept, int* const out) { vstore16(kept->index, 0, out); }

static void keep(Kept* const kept, const float squared, const int index) {
    if (!(squared < kept->worst || (squared == kept->worst && (uint)index < (uint)kept->index.sf))) return;
    // points after the new one move up by a lane
    const int16 after = kept->squared > squared || (kept->squared == squared && as_uint16(kept->index) > (uint)index);
    const int16 beyond = (int16)(0, after.s01234567, after.s89ab, after.scde);
    const float16 moved = (float16)(squared, kept->squared.s01234567, kept->squared.s89ab, kept->squared.scde);
    const int16 moved_index = (int16)(index, kept->index.s01234567, kept->index.s89ab, kept->index.scde);
    kept->squared = select(kept->squared, select((float16)(squared), moved, beyond), after);
    kept->index = select(kept->index, select((int16)(index), moved_index, beyond), after);
    kept->worst = kept->squared.sf;
}
#endif

static void keep_run(__global const float4* const restrict points, const int first, const int last, const float3 place,
                     Kept* const kept) {
    for (int n = first; n < last; ++n) {
        const float3 away = points[n].xyz - place;
        keep(kept, dot(away, away), n);
    }
}

// Squared distance along an axis from `at` to the cell `step` cells from its own, which begins at `begin`.
static float gap_squared(const int step, const float at, const float begin, const float size) {
    const float gap = step > 0 ? begin + step * size - at : step < 0 ? at - begin - (step + 1) * size : 0.0f;
    return gap > 0.0f ? gap * gap : 0.0f;
}

static Kept search(__global const float4* const restrict points, __global const int* const restrict starts,
                   const float8 box, const float3 place, const float reach_squared) {
    Kept kept = none(reach_squared);
    const float size = box.s3;
    const int3 count = (int3)((int)box.s4, (int)box.s5, (int)box.s6);
    // NaN goes to cell 0, where no point is near it
    const int3 cell = clamp(convert_int3_sat(floor((place - box.s012) / size)), (int3)(0), count - 1);
    const float3 begin = box.s012 + convert_float3(cell) * size;
    const float3 inside = fmin(place - begin, begin + size - place);
    const float border = fmax(fmin(fmin(inside.x, inside.y), inside.z), 0.0f);
    const int3 farther = max(cell, count - 1 - cell);
    const int rings = max(max(farther.x, farther.y), farther.z);
    for (int ring = 0; ring <= rings; ++ring) {
        const float nearest = (ring - 1) * size + border;
        if (ring > 0 && !(nearest * nearest <= kept.worst)) break;
        for (int x = max(-ring, -cell.x); x <= min(ring, count.x - 1 - cell.x); ++x) {
            const float along_x = gap_squared(x, place.x, begin.x, size);
            if (along_x > kept.worst) continue;
            for (int y = max(-ring, -cell.y); y <= min(ring, count.y - 1 - cell.y); ++y) {
                const float column = along_x + gap_squared(y, place.y, begin.y, size);
                if (column > kept.worst) continue;
                __global const int* const row = starts + ((cell.x + x) * count.y + cell.y + y) * count.z;
                const int low = cell.z - ring;
                const int high = cell.z + ring;
                if (abs(x) == ring || abs(y) == ring) {
                    keep_run(points, row[max(low, 0)], row[min(high, count.z - 1) + 1], place, &kept);
                    continue;
                }
                if (low >= 0 && column + gap_squared(-ring, place.z, begin.z, size) <= kept.worst)
                    keep_run(points, row[low], row[low + 1], place, &kept);
                if (high < count.z && column + gap_squared(ring, place.z, begin.z, size) <= kept.worst)
                    keep_run(points, row[high], row[high + 1], place, &kept);
            }
        }
    }
    return kept;
}

// An element of a surface: 12 float32.
//
// s012 the point, s3 whether it has neighbors on all sides (1) or lies at a rim (0), s456 the unit normal, of either
// sign, s7 the number of the direction nearest to the normal, s89a the ray from the sensor to the point, 0 if not
// known, sb unused.
typedef struct {
    float4 point;
    float4 normal;
    float4 ray;
} Element;

static Element element(__global const float4* const restrict elements, const int n) {
    return (Element){elements[3 * n], elements[3 * n + 1], elements[3 * n + 2]};
}

// R v, the inverse of R times v, and t, of a pose whose rows are [R | t].
static float3 turned(const float16 T, const float3 v) {
    return (float3)(dot(T.s012, v), dot(T.s456, v), dot(T.s89a, v));
}

static float3 turned_back(const float16 T, const float3 v) { return T.s012 * v.x + T.s456 * v.y + T.s89a * v.z; }

static float3 shift_of(const float16 T) { return T.s37b; }
