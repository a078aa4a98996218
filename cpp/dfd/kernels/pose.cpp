// Computes Eq. (1) and (8) for blocks of vertices, one vertex per vector lane.

#include "dfd/kernels/posed.hpp"

namespace dfd {
namespace {

// Vertices and weights are prefetched this many bytes before they are read. With one handle, memory limits the speed.
constexpr std::size_t vertices_ahead = 1536, weights_ahead = 512;

// Pointers to the data of the first of several consecutive vertices.
template <class T>
struct VertexData {
    const T *vertices, *base, *normals;
    T *posed, *posed_normals;
};

// Poses one vector of vertices; `check` becomes NaN if a result is not finite.
template <class Kind, class T>
DFD_INLINE void pose_lanes(const PoseJob<T>& job, const VertexData<T>& at, const Weights<T>& weights, Vector<T>& check)
{
    const Vector<T> zero{};
    const Vector3<T> vertex = Interleaved<T>::read(at.vertices);
    const Vector3<T> p{vertex.x - job.center[0], vertex.y - job.center[1], vertex.z - job.center[2]};
    const auto [remainder, excess, factor] = totals(job, weights);

    Sums<T, Kind::count> sums;
    if (job.negative == nullptr) {
        sums = blended<Kind>(job, job.positive, weights, remainder);
    } else {
        const Vector<T> share = Share<T>(job, p).value;
        const auto above = equal(share, zero + T(1)), below = equal(share, zero);
        if (all(above)) {
            sums = blended<Kind>(job, job.positive, weights, remainder);
        } else if (all(below)) {
            sums = blended<Kind>(job, job.negative, weights, remainder);
        } else {  // a vertex outside the band gets the same bits here as in the branches above
            sums = blended<Kind>(job, job.negative, weights, remainder);
            const Sums<T, Kind::count> positive_sum = blended<Kind>(job, job.positive, weights, remainder);
            for (std::size_t e = 0; e < Kind::count; ++e) {
                const Vector<T> mixed = multiply_add(share, positive_sum.entry[e] - sums.entry[e], sums.entry[e]);
                sums.entry[e] = select(above, positive_sum.entry[e], select(below, sums.entry[e], mixed));
            }
        }
    }
    if (job.overlap != Overlap::add)
        for (std::size_t e = 0; e < Kind::count; ++e) sums.entry[e] *= factor;

    Vector3<T> shift = Kind::displacement(sums.entry, p);
    Vector3<T> from = vertex;
    if (at.base != nullptr) {
        from = Interleaved<T>::read(at.base);
    } else if (job.overlap == Overlap::paper) {  // Equation (1) adds `excess` times the position
        shift = {multiply_add(excess, vertex.x, shift.x), multiply_add(excess, vertex.y, shift.y),
                 multiply_add(excess, vertex.z, shift.z)};
    }
    const Vector3<T> posed{from.x + shift.x, from.y + shift.y, from.z + shift.z};
    check = multiply_add(posed.x, zero, check);
    check = multiply_add(posed.y, zero, check);
    check = multiply_add(posed.z, zero, check);
    Interleaved<T>::write(at.posed, posed);

    if (at.normals != nullptr) {
        const Vector3<T> normal = Kind::transformed_normal(sums.entry, excess, Interleaved<T>::read(at.normals));
        check = multiply_add(normal.x + normal.y + normal.z, zero, check);
        Interleaved<T>::write(at.posed_normals, normal);
    }
}

template <class Kind, class T>
DFD_INLINE void pose_block(const PoseJob<T>& job, const VertexData<T>& at, const Weights<T>& weights, Vector<T>& check)
{
    for (std::size_t lane = 0; lane < block_size; lane += lanes<T>) {
        const VertexData<T> here{at.vertices + 3 * lane, advanced(at.base, 3 * lane), advanced(at.normals, 3 * lane),
                                 at.posed + 3 * lane, advanced(at.posed_normals, 3 * lane)};
        pose_lanes<Kind>(job, here, {weights.first + lane, weights.stride}, check);
    }
}

// Poses vertices in the case of one handle without mirror plane, D_0 and normals. Returns the end of the posed range.
// The handle's transform stays in registers. The displacement of a vertex is multiplied by the vertex's weight.
template <class T>
DFD_INLINE std::size_t pose_single(const PoseJob<T>& job, std::size_t begin, std::size_t end, Vector<T>& check)
{
    const PoseJob<T> own = job;  // a local copy, so that stores cannot alias it
    Vector<T> entry[12];
    for (std::size_t e = 0; e < 12; ++e) entry[e] = splat(own.positive[e]);
    const Vector<T> zero{}, one = zero + T(1);
    const bool paper = own.overlap == Overlap::paper, normalize = own.overlap == Overlap::normalize;
    const Vector3<T> center{splat(own.center[0]), splat(own.center[1]), splat(own.center[2])};
    Vector<T> nonfinite = check;
    std::size_t i = begin;
    for (; i + lanes<T> <= end; i += lanes<T>) {
        prefetch(own.vertices + 3 * i, vertices_ahead, 3 * vector_bytes);
        prefetch(own.weights + i, weights_ahead, 1);
        prefetch<true>(own.posed + 3 * i, vertices_ahead, 3 * vector_bytes);
        const Vector3<T> vertex = Interleaved<T>::read(own.vertices + 3 * i);
        const Vector<T> given = load_weights<T>(own.weights + i);
        const Vector<T> weight = normalize ? minimum(one, given) : given;
        const Vector3<T> p{vertex.x - center.x, vertex.y - center.y, vertex.z - center.z};
        const auto moved = [&](std::size_t e, Vector<T> from) __attribute__((always_inline)) {
            const Vector<T> near = multiply_add(entry[e + 1], p.y, multiply_add(entry[e + 2], p.z, entry[e + 3]));
            return multiply_add(weight, multiply_add(entry[e], p.x, near), from);
        };
        Vector3<T> posed;
        if (own.base != nullptr) {
            prefetch(own.base + 3 * i, vertices_ahead, 3 * vector_bytes);
            const Vector3<T> from = Interleaved<T>::read(own.base + 3 * i);
            posed = {moved(0, from.x), moved(4, from.y), moved(8, from.z)};
        } else if (!paper) {
            posed = {moved(0, vertex.x), moved(4, vertex.y), moved(8, vertex.z)};
        } else {
            const Vector<T> excess = maximum(weight - one, zero);
            posed = {moved(0, multiply_add(excess, vertex.x, vertex.x)),
                     moved(4, multiply_add(excess, vertex.y, vertex.y)),
                     moved(8, multiply_add(excess, vertex.z, vertex.z))};
        }
        nonfinite = multiply_add(posed.x, zero, multiply_add(posed.y, zero, multiply_add(posed.z, zero, nonfinite)));
        Interleaved<T>::write(own.posed + 3 * i, posed);
    }
    check = nonfinite;
    return i;
}

template <class Kind, class T>
DFD_INLINE bool pose_blocks(const PoseJob<T>& shared_job, std::size_t begin, std::size_t end, float* scratch)
{
    const PoseJob<T> job = shared_job;  // a local copy, so that stores cannot alias it
    Vector<T> check{};
    const bool columns = job.row_stride == 1;
    const bool single =
        job.blend == Blend::linear && job.handle_count == 1 && columns && job.negative == nullptr &&
        job.rest == nullptr && job.normals == nullptr;
    if (single) begin = pose_single(job, begin, begin + (end - begin) / block_size * block_size, check);
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::size_t count = end - i < block_size ? end - i : block_size;
        prefetch(job.vertices + 3 * i, vertices_ahead, 3 * block_size * sizeof(T));
        prefetch<true>(job.posed + 3 * i, vertices_ahead, 3 * block_size * sizeof(T));
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
            const VertexData<T> here{job.vertices + 3 * i, base, normals, job.posed + 3 * i, posed_normals};
            pose_block<Kind>(job, here, weights, check);
        } else {
            T padded[5][3 * block_size];
            for (std::size_t lane = 0; lane < 3 * block_size; ++lane) {
                const std::size_t from = lane < 3 * count ? lane : lane % 3;
                padded[0][lane] = job.vertices[3 * i + from];
                padded[1][lane] = base == nullptr ? T(0) : base[from];
                padded[2][lane] = normals == nullptr ? T(0) : normals[from];
            }
            const VertexData<T> here{padded[0], base == nullptr ? nullptr : padded[1],
                                     normals == nullptr ? nullptr : padded[2], padded[3], padded[4]};
            if (single) {
                PoseJob<T> alone = job;
                alone.vertices = here.vertices;
                alone.base = here.base;
                alone.posed = here.posed;
                alone.weights = scratch;
                pose_single(alone, 0, block_size, check);
            } else {
                pose_block<Kind>(job, here, weights, check);
            }
            copy(padded[3], 3 * count, job.posed + 3 * i);
            if (normals != nullptr) copy(padded[4], 3 * count, posed_normals);
        }
    }
    return all(equal(check, check));
}

// The kind of blend is a template parameter of `pose_blocks`, so that the compiler keeps the sums in registers.
template <class T>
DFD_INLINE bool pose_range(const PoseJob<T>& job, std::size_t begin, std::size_t end, float* scratch)
{
    switch (job.blend) {
    case Blend::dual_quaternion:
        return job.stretched ? pose_blocks<DualQuaternionBlend<T, true>>(job, begin, end, scratch)
                             : pose_blocks<DualQuaternionBlend<T, false>>(job, begin, end, scratch);
    default: return pose_blocks<LinearBlend<T>>(job, begin, end, scratch);
    }
}

}  // namespace

namespace DFD_VARIANT {

bool pose_float(const PoseJob<float>& job, std::size_t begin, std::size_t end, float* scratch)
{
    return pose_range(job, begin, end, scratch);
}

bool pose_double(const PoseJob<double>& job, std::size_t begin, std::size_t end, float* scratch)
{
    return pose_range(job, begin, end, scratch);
}

}  // namespace DFD_VARIANT
}  // namespace dfd
