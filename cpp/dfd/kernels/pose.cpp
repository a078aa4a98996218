// Eq. (1) and (8) for blocks of vertices, one vertex per lane. A vertex moves by its blended displacement.

#include "dfd/kernels/transpose.hpp"
#include "dfd/kernels/variants.hpp"

namespace dfd {
namespace {

// Bytes between what is posed and what is prefetched, to read and to write: for one handle there is little else to do.
constexpr std::size_t vertices_ahead = 1536, weights_ahead = 512;

template <class T>
struct Vector3 {
    Vector<T> x, y, z;
};

template <class T>
struct Displacement {
    Vector<T> entry[12];
};

// Where the next 3 W interleaved coordinates keep x, y and z.
template <class T> struct Interleaved;

#if defined(__AVX512F__)
template <>
struct Interleaved<float> {
    static DFD_INLINE Vector3<float> read(const float* from)
    {
        const Float a = load<Float>(from), b = load<Float>(from + 16), c = load<Float>(from + 32);
        const Float x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Float y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Float z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29),
                __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30),
                __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31)};
    }
    static DFD_INLINE void write(float* to, const Vector3<float>& p)
    {
        const Float a = __builtin_shufflevector(p.x, p.y, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
        const Float b = __builtin_shufflevector(p.x, p.y, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
        const Float c = __builtin_shufflevector(p.x, p.y, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
        store(to, (Float)__builtin_shufflevector(a, p.z, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15));
        store(to + 16, (Float)__builtin_shufflevector(b, p.z, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15));
        store(to + 32, (Float)__builtin_shufflevector(c, p.z, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31));
    }
};
#endif

// Vectors of eight, built from halves where the machine has only those.
#if defined(__AVX512F__)
typedef Double Eight;
#define DFD_EIGHT double
#elif defined(__AVX2__)
typedef Float Eight;
#define DFD_EIGHT float
#endif

#if defined(__AVX2__)
template <>
struct Interleaved<DFD_EIGHT> {
    static DFD_INLINE Vector3<DFD_EIGHT> read(const DFD_EIGHT* from)
    {
        const Eight a = load<Eight>(from), b = load<Eight>(from + 8), c = load<Eight>(from + 16);
        const Eight x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0);
        const Eight y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0);
        const Eight z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 10, 13),
                __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 8, 11, 14),
                __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 9, 12, 15)};
    }
    static DFD_INLINE void write(DFD_EIGHT* to, const Vector3<DFD_EIGHT>& p)
    {
        const Eight a = __builtin_shufflevector(p.x, p.y, 0, 8, 0, 1, 9, 0, 2, 10);
        const Eight b = __builtin_shufflevector(p.x, p.y, 0, 3, 11, 0, 4, 12, 0, 5);
        const Eight c = __builtin_shufflevector(p.x, p.y, 13, 0, 6, 14, 0, 7, 15, 0);
        store(to, (Eight)__builtin_shufflevector(a, p.z, 0, 1, 8, 3, 4, 9, 6, 7));
        store(to + 8, (Eight)__builtin_shufflevector(b, p.z, 10, 1, 2, 11, 4, 5, 12, 7));
        store(to + 16, (Eight)__builtin_shufflevector(c, p.z, 0, 13, 2, 3, 14, 5, 6, 15));
    }
};
#endif

#if !defined(__AVX512F__)
#if defined(__AVX2__)
typedef Double Four;
#define DFD_FOUR double
#else
typedef Float Four;
#define DFD_FOUR float
#endif

template <>
struct Interleaved<DFD_FOUR> {
    static DFD_INLINE Vector3<DFD_FOUR> read(const DFD_FOUR* from)
    {
        const Four a = load<Four>(from), b = load<Four>(from + 4), c = load<Four>(from + 8);
        const Four x = __builtin_shufflevector(a, b, 0, 3, 6, 6), y = __builtin_shufflevector(a, b, 1, 4, 7, 7);
        const Four z = __builtin_shufflevector(a, b, 2, 5, 5, 5);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 5), __builtin_shufflevector(y, c, 0, 1, 2, 6),
                __builtin_shufflevector(z, c, 0, 1, 4, 7)};
    }
    static DFD_INLINE void write(DFD_FOUR* to, const Vector3<DFD_FOUR>& p)
    {
        const Four a = __builtin_shufflevector(p.x, p.y, 0, 4, 0, 1), b = __builtin_shufflevector(p.x, p.y, 5, 0, 2, 6);
        const Four c = __builtin_shufflevector(p.x, p.y, 0, 3, 7, 0);
        store(to, (Four)__builtin_shufflevector(a, p.z, 0, 1, 4, 3));
        store(to + 4, (Four)__builtin_shufflevector(b, p.z, 0, 5, 2, 3));
        store(to + 8, (Four)__builtin_shufflevector(c, p.z, 6, 1, 2, 7));
    }
};
#endif

#if !defined(__AVX2__)
template <>
struct Interleaved<double> {
    static DFD_INLINE Vector3<double> read(const double* from)
    {
        const Double a = load<Double>(from), b = load<Double>(from + 2), c = load<Double>(from + 4);
        return {__builtin_shufflevector(a, b, 0, 3), __builtin_shufflevector(a, c, 1, 2),
                __builtin_shufflevector(b, c, 0, 3)};
    }
    static DFD_INLINE void write(double* to, const Vector3<double>& p)
    {
        store(to, (Double)__builtin_shufflevector(p.x, p.y, 0, 2));
        store(to + 2, (Double)__builtin_shufflevector(p.z, p.x, 0, 3));
        store(to + 4, (Double)__builtin_shufflevector(p.y, p.z, 1, 3));
    }
};
#endif

template <class T>
DFD_INLINE Vector<T> load_weights(const float* from)
{
    if constexpr (sizeof(T) == sizeof(float)) {
        return load<Float>(from);
    } else {
        typedef float Half __attribute__((vector_size(vector_bytes / 2)));
        return __builtin_convertvector(load<Half>(from), Double);
    }
}

template <class T>
struct Weights {
    const float* first;    // of the lane's vertex for handle 0
    std::size_t stride;    // to the next handle

    DFD_INLINE Vector<T> operator()(std::size_t k) const { return load_weights<T>(first + k * stride); }
};

template <class T>
DFD_INLINE void accumulate(Displacement<T>& blend, const T* entries, Vector<T> weight)
{
#pragma GCC unroll 12
    for (std::size_t e = 0; e < 12; ++e) blend.entry[e] = fused(weight, splat(entries[e]), blend.entry[e]);
}

template <class T>
DFD_INLINE Displacement<T> blended(const PoseJob<T>& job, const T* table, const Weights<T>& weights, Vector<T> left)
{
    Displacement<T> blend{};
    for (std::size_t k = 0; k < job.handle_count; ++k) accumulate(blend, table + 12 * k, weights(k));
    if (job.rest != nullptr) accumulate(blend, job.rest, left);
    return blend;
}

// How much of each vertex belongs to the positive side: a step, or a smoothstep over the band.
template <class T>
DFD_INLINE Vector<T> positive_share(const PoseJob<T>& job, const Vector3<T>& p)
{
    const Vector<T> zero{};
    Vector<T> height = splat(job.height);
    height = fused(p.x, splat(job.normal[0]), height);
    height = fused(p.y, splat(job.normal[1]), height);
    height = fused(p.z, splat(job.normal[2]), height);
    if (job.steepness == 0) return select(at_least(height, zero), zero + T(1), zero);
    const Vector<T> t = minimum(maximum(fused(height, splat(job.steepness), zero + T(0.5)), zero), zero + T(1));
    return t * t * (T(3) - T(2) * t);
}

// Normals turn by the cofactors of the blended linear part, whose rows are a, b and c.
template <class T>
DFD_INLINE Vector3<T> turned(const Displacement<T>& d, Vector<T> excess, const Vector3<T>& normal)
{
    const Vector<T> one = excess + T(1);
    const Vector3<T> a{d.entry[0] + one, d.entry[1], d.entry[2]};
    const Vector3<T> b{d.entry[4], d.entry[5] + one, d.entry[6]};
    const Vector3<T> c{d.entry[8], d.entry[9], d.entry[10] + one};
    const auto triple = [&](const Vector3<T>& u, const Vector3<T>& v) __attribute__((always_inline)) {
        return (u.y * v.z - u.z * v.y) * normal.x + (u.z * v.x - u.x * v.z) * normal.y +
               (u.x * v.y - u.y * v.x) * normal.z;
    };
    const Vector3<T> n{triple(b, c), triple(c, a), triple(a, b)};
    const Vector<T> length = root(n.x * n.x + n.y * n.y + n.z * n.z);
    const auto flat = equal(length, Vector<T>{});  // a part squeezed flat keeps its normals
    const Vector<T> scale = T(1) / select(flat, Vector<T>{} + T(1), length);
    return {select(flat, normal.x, n.x * scale), select(flat, normal.y, n.y * scale),
            select(flat, normal.z, n.z * scale)};
}

template <class T>
struct Lanes {
    const T *vertices, *base, *normals;
    T *posed, *posed_normals;
};

// Poses one vector of vertices; `check` turns NaN when a result is not finite.
template <class T>
DFD_INLINE void pose_lanes(const PoseJob<T>& job, const Lanes<T>& at, const Weights<T>& weights, Vector<T>& check)
{
    const Vector<T> zero{};
    const Vector3<T> vertex = Interleaved<T>::read(at.vertices);
    const Vector3<T> p{vertex.x - job.center[0], vertex.y - job.center[1], vertex.z - job.center[2]};

    Vector<T> sum = zero;
    for (std::size_t k = 0; k < job.handle_count; ++k) sum += weights(k);
    const Vector<T> left = maximum(T(1) - sum, zero);
    const Vector<T> excess = maximum(sum - T(1), zero);  // Equation (1) scales a vertex whose weights pass 1

    Displacement<T> blend;
    if (job.negative == nullptr) {
        blend = blended(job, job.positive, weights, left);
    } else {
        const Vector<T> share = positive_share(job, p);
        const auto above = equal(share, zero + T(1)), below = equal(share, zero);
        if (all(above)) {
            blend = blended(job, job.positive, weights, left);
        } else if (all(below)) {
            blend = blended(job, job.negative, weights, left);
        } else {  // what a lane gets is the same on every branch
            blend = blended(job, job.negative, weights, left);
            const Displacement<T> other = blended(job, job.positive, weights, left);
            for (std::size_t e = 0; e < 12; ++e) {
                const Vector<T> mixed = fused(share, other.entry[e] - blend.entry[e], blend.entry[e]);
                blend.entry[e] = select(above, other.entry[e], select(below, blend.entry[e], mixed));
            }
        }
    }

    const auto row = [&](std::size_t e) __attribute__((always_inline)) {
        return fused(blend.entry[e], p.x,
                     fused(blend.entry[e + 1], p.y, fused(blend.entry[e + 2], p.z, blend.entry[e + 3])));
    };
    Vector3<T> shift{row(0), row(4), row(8)};
    Vector3<T> from = vertex;
    if (at.base != nullptr) {
        from = Interleaved<T>::read(at.base);
    } else {
        shift = {fused(excess, vertex.x, shift.x), fused(excess, vertex.y, shift.y), fused(excess, vertex.z, shift.z)};
    }
    const Vector3<T> posed{from.x + shift.x, from.y + shift.y, from.z + shift.z};
    check = fused(posed.x, zero, check);
    check = fused(posed.y, zero, check);
    check = fused(posed.z, zero, check);
    Interleaved<T>::write(at.posed, posed);

    if (at.normals != nullptr) {
        const Vector3<T> turned_normal = turned<T>(blend, excess, Interleaved<T>::read(at.normals));
        check = fused(turned_normal.x + turned_normal.y + turned_normal.z, zero, check);
        Interleaved<T>::write(at.posed_normals, turned_normal);
    }
}

template <class P>
DFD_INLINE P* advanced(P* pointer, std::size_t count)
{
    return pointer == nullptr ? nullptr : pointer + count;
}

template <class T>
DFD_INLINE void pose_block(const PoseJob<T>& job, const Lanes<T>& at, const Weights<T>& weights, Vector<T>& check)
{
    for (std::size_t lane = 0; lane < block_size; lane += lanes<T>) {
        const Lanes<T> here{at.vertices + 3 * lane, advanced(at.base, 3 * lane), advanced(at.normals, 3 * lane),
                            at.posed + 3 * lane, advanced(at.posed_normals, 3 * lane)};
        pose_lanes<T>(job, here, {weights.first + lane, weights.stride}, check);
    }
}

// One handle and nothing else: the displacement stays in registers, and the weight scales what it does.
template <class T>
DFD_INLINE std::size_t pose_single(const PoseJob<T>& job, std::size_t begin, std::size_t end, Vector<T>& check)
{
    const PoseJob<T> own = job;  // which no store can touch
    Vector<T> entry[12];
    for (std::size_t e = 0; e < 12; ++e) entry[e] = splat(own.positive[e]);
    const Vector<T> zero{}, one = zero + T(1);
    const Vector3<T> center{splat(own.center[0]), splat(own.center[1]), splat(own.center[2])};
    Vector<T> met = check;
    std::size_t i = begin;
    for (; i + lanes<T> <= end; i += lanes<T>) {
        prefetch(own.vertices + 3 * i, vertices_ahead, 3 * vector_bytes);
        prefetch(own.weights + i, weights_ahead, 1);
        prefetch<true>(own.posed + 3 * i, vertices_ahead, 3 * vector_bytes);
        const Vector3<T> vertex = Interleaved<T>::read(own.vertices + 3 * i);
        const Vector<T> weight = load_weights<T>(own.weights + i);
        const Vector3<T> p{vertex.x - center.x, vertex.y - center.y, vertex.z - center.z};
        const auto moved = [&](std::size_t e, Vector<T> from) __attribute__((always_inline)) {
            return fused(weight,
                         fused(entry[e], p.x, fused(entry[e + 1], p.y, fused(entry[e + 2], p.z, entry[e + 3]))), from);
        };
        Vector3<T> posed;
        if (own.base != nullptr) {
            prefetch(own.base + 3 * i, vertices_ahead, 3 * vector_bytes);
            const Vector3<T> from = Interleaved<T>::read(own.base + 3 * i);
            posed = {moved(0, from.x), moved(4, from.y), moved(8, from.z)};
        } else {
            const Vector<T> excess = maximum(weight - one, zero);
            posed = {moved(0, fused(excess, vertex.x, vertex.x)), moved(4, fused(excess, vertex.y, vertex.y)),
                     moved(8, fused(excess, vertex.z, vertex.z))};
        }
        met = fused(posed.x, zero, fused(posed.y, zero, fused(posed.z, zero, met)));
        Interleaved<T>::write(own.posed + 3 * i, posed);
    }
    check = met;
    return i;
}

template <class T>
DFD_INLINE bool pose_range(const PoseJob<T>& job, std::size_t begin, std::size_t end, float* scratch)
{
    Vector<T> check{};
    const bool columns = job.row_stride == 1;
    const bool single =
        job.handle_count == 1 && columns && job.negative == nullptr && job.rest == nullptr && job.normals == nullptr;
    if (single) begin = pose_single(job, begin, begin + (end - begin) / block_size * block_size, check);
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::size_t count = end - i < block_size ? end - i : block_size;
        Weights<T> weights{job.weights + i, job.column_stride};
        if (!columns || count < block_size) {
            if (columns) {
                for (std::size_t k = 0; k < job.handle_count; ++k)
                    for (std::size_t lane = 0; lane < block_size; ++lane)
                        scratch[k * block_size + lane] = lane < count ? job.weights[i + lane + k * job.column_stride] : 0;
            } else {
                rows_to_lanes(job.weights + i * job.row_stride, job.row_stride, job.handle_count, count, scratch);
            }
            weights = {scratch, block_size};
        }
        const T *base = advanced(job.base, 3 * i), *normals = advanced(job.normals, 3 * i);
        T* posed_normals = advanced(job.posed_normals, 3 * i);
        if (count == block_size) {
            pose_block<T>(job, {job.vertices + 3 * i, base, normals, job.posed + 3 * i, posed_normals}, weights, check);
        } else {
            T padded[5][3 * block_size];
            for (std::size_t lane = 0; lane < 3 * block_size; ++lane) {
                const std::size_t from = lane < 3 * count ? lane : lane % 3;
                padded[0][lane] = job.vertices[3 * i + from];
                padded[1][lane] = base == nullptr ? T(0) : base[from];
                padded[2][lane] = normals == nullptr ? T(0) : normals[from];
            }
            const Lanes<T> here{padded[0], base == nullptr ? nullptr : padded[1],
                                normals == nullptr ? nullptr : padded[2], padded[3], padded[4]};
            if (single) {
                PoseJob<T> alone = job;
                alone.vertices = here.vertices;
                alone.base = here.base;
                alone.posed = here.posed;
                alone.weights = scratch;
                pose_single(alone, 0, block_size, check);
            } else {
                pose_block<T>(job, here, weights, check);
            }
            copy(padded[3], 3 * count, job.posed + 3 * i);
            if (normals != nullptr) copy(padded[4], 3 * count, posed_normals);
        }
    }
    return all(equal(check, check));
}

}  // namespace

bool DFD_VARIANT::pose_float(const PoseJob<float>& job, std::size_t begin, std::size_t end, float* scratch)
{
    return pose_range(job, begin, end, scratch);
}

bool DFD_VARIANT::pose_double(const PoseJob<double>& job, std::size_t begin, std::size_t end, float* scratch)
{
    return pose_range(job, begin, end, scratch);
}

}  // namespace dfd
