// Computes the gradients of Eq. (1) and (8) for blocks of vertices, one vertex per vector lane.
//
// With the gradient g of a posed vertex, the weight w of a handle and its entries A (3, 4), the blend V' = V + w A [p, 1]
// has the gradients w (g ⊗ [p, 1]) for A, g · A [p, 1] for w, and g + w Aᵀ g for V. The products g ⊗ [p, 1] of a tile of
// vertices stay in the cache. For each handle, their weighted sum then stays in twelve registers.

#include "dfd/kernels/posed.hpp"

namespace dfd {
namespace {

constexpr std::size_t tile_blocks = gradient_tile / block_size;
constexpr std::size_t entries = 12;

// The values of a tile of vertices that the sums over the tile need.
template <class T>
struct Tile {
    T* products[2];  // (12, 128) g ⊗ [p, 1] for the positive and the negative side of the mirror plane
    T* remainder;    // (128) weights of D_0
    bool side[2];    // whether a vertex lies on this side
    Weights<T> weights[tile_blocks];
};

// Returns the sum of the products of two vectors of entries, the second of which is in memory.
template <class T>
DFD_INLINE Vector<T> product(const Vector<T> (&entry)[entries], const T* table)
{
    Vector<T> sum = entry[0] * splat(table[0]);
#pragma GCC unroll 12
    for (std::size_t e = 1; e < entries; ++e) sum = multiply_add(entry[e], splat(table[e]), sum);
    return sum;
}

// Returns g ⊗ [p, 1].
template <class T>
DFD_INLINE void outer(const Vector3<T>& g, const Vector3<T>& p, Vector<T> (&entry)[entries])
{
    const Vector<T> rows[3] = {g.x, g.y, g.z};
#pragma GCC unroll 3
    for (std::size_t row = 0; row < 3; ++row) {
        entry[4 * row] = rows[row] * p.x;
        entry[4 * row + 1] = rows[row] * p.y;
        entry[4 * row + 2] = rows[row] * p.z;
        entry[4 * row + 3] = rows[row];
    }
}

// Adds Aᵀ g to `sum`, in which A is the linear part of the entries.
template <class T>
DFD_INLINE void add_transposed(const Vector<T>* entry, const Vector3<T>& g, Vector3<T>& sum)
{
    const auto column = [&](std::size_t c, Vector<T> from) __attribute__((always_inline)) {
        return multiply_add(entry[c], g.x, multiply_add(entry[c + 4], g.y, multiply_add(entry[c + 8], g.z, from)));
    };
    sum = {column(0, sum.x), column(1, sum.y), column(2, sum.z)};
}

// Computes the gradients of one vector of vertices. `vertices` and `posed` point to the first of them, as do
// `vertex_gradients` and `weight_gradients`, which may be null; the latter has 16 entries for each handle. `at` is the
// index of the first vertex in the tile.
template <class T>
DFD_INLINE void differentiate_lanes(const PoseGradientJob<T>& job, const Weights<T>& weights, const T* vertices,
                                    const T* posed, T* vertex_gradients, T* weight_gradients, Tile<T>& tile,
                                    std::size_t at)
{
    const PoseJob<T>& pose = job.pose;
    const Vector<T> zero{}, one = zero + T(1);
    const Vector3<T> vertex = Interleaved<T>::read(vertices), g = Interleaved<T>::read(posed);
    const Vector3<T> p{vertex.x - pose.center[0], vertex.y - pose.center[1], vertex.z - pose.center[2]};
    Vector<T> sum = zero;
    for (std::size_t k = 0; k < pose.handle_count; ++k) sum += weights(k);
    const auto partial = at_least(one, sum);  // whether the sum is at most 1, so that D_0 has the remainder
    const Vector<T> remainder = maximum(one - sum, zero);
    const Vector<T> factor = pose.overlap == Overlap::normalize ? one / maximum(sum, one) : one;
    const Vector<T> excess = pose.overlap == Overlap::paper ? maximum(sum - one, zero) : zero;

    const Share<T> share(pose, p);  // 1 without a mirror plane
    const Vector<T> shares[2] = {share.value, one - share.value};
    const T* tables[2] = {pose.positive, pose.negative};
    Vector3<T> gradient{multiply_add(excess, g.x, g.x), multiply_add(excess, g.y, g.y), multiply_add(excess, g.z, g.z)};
    Vector<T> displaced[2] = {zero, zero};  // g · displacement on each side, for the gradient of the share
    Vector<T> through_sum = zero;           // gradient with respect to the sum of the weights
    if (pose.overlap == Overlap::paper) through_sum = select(partial, zero, dot<T>(g, vertex));
    bool begun = false;

    for (std::size_t s = 0; s < 2; ++s) {
        const bool empty = all(equal(shares[s], zero));
        T* const products = tile.products[s] + at;
        if (empty) {
            if (job.transforms)
                for (std::size_t e = 0; e < entries; ++e) store(products + e * gradient_tile, zero);
            continue;
        }
        tile.side[s] = true;
        const Vector<T> scale = shares[s] * factor;
        Vector<T> entry[entries];
        outer<T>(scaled<T>(g, scale), p, entry);
        if (job.transforms)
            for (std::size_t e = 0; e < entries; ++e) store(products + e * gradient_tile, entry[e]);
        if (weight_gradients != nullptr) {
            for (std::size_t k = 0; k < pose.handle_count; ++k) {
                T* const to = weight_gradients + k * block_size;
                const Vector<T> value = product<T>(entry, tables[s] + entries * k);
                store(to, begun ? load<Vector<T>>(to) + value : value);
            }
            if (pose.rest != nullptr) through_sum = select(partial, through_sum - product<T>(entry, pose.rest), through_sum);
            begun = true;
        }
        if (vertex_gradients != nullptr) {
            const Sums<T, entries> sums = blended<LinearBlend<T>>(pose, tables[s], weights, remainder);
            add_transposed<T>(sums.entry, scaled<T>(g, scale), gradient);
            displaced[s] = factor * dot<T>(g, LinearBlend<T>::displacement(sums.entry, p));
        }
    }
    if (job.transforms) store(tile.remainder + at, remainder);

    if (weight_gradients != nullptr) {
        if (pose.overlap == Overlap::normalize) {
            // The factor 1 / S has the derivative -1 / S², so the displacement has the gradient -(displacement / S).
            Vector<T> moved = zero;
            for (std::size_t k = 0; k < pose.handle_count; ++k)
                moved = multiply_add(weights(k), load<Vector<T>>(weight_gradients + k * block_size), moved);
            through_sum = select(partial, through_sum, through_sum - moved * factor);
        }
        for (std::size_t k = 0; k < pose.handle_count; ++k) {
            T* const to = weight_gradients + k * block_size;
            store(to, load<Vector<T>>(to) + through_sum);
        }
    }
    if (vertex_gradients != nullptr) {
        if (pose.negative != nullptr && pose.steepness != 0) {
            const Vector<T> slope = T(6) * share.step * (one - share.step) * splat(pose.steepness);
            if (!all(equal(slope, zero))) {
                // In the band, both shares are above 0, so both displacements are known.
                const Vector<T> along = slope * (displaced[0] - displaced[1]);
                gradient = {multiply_add(along, splat(pose.normal[0]), gradient.x),
                            multiply_add(along, splat(pose.normal[1]), gradient.y),
                            multiply_add(along, splat(pose.normal[2]), gradient.z)};
            }
        }
        Interleaved<T>::write(vertex_gradients, gradient);
    }
}

// Adds, for each handle, the weighted sums of the tile's products to `sums` (2, H + 1, 12), vectors of partial sums.
template <class T>
DFD_INLINE void add_products(const PoseJob<T>& pose, const Tile<T>& tile, std::size_t blocks, T* sums)
{
    const auto add = [&](const T* products, T* to, const auto& weight) __attribute__((always_inline)) {
        Vector<T> part[entries];
#pragma GCC unroll 12
        for (std::size_t e = 0; e < entries; ++e) part[e] = load<Vector<T>>(to + e * lanes<T>);
        for (std::size_t block = 0; block < blocks; ++block) {
            for (std::size_t lane = 0; lane < block_size; lane += lanes<T>) {
                const T* const from = products + block * block_size + lane;
                const Vector<T> w = weight(block, lane);
#pragma GCC unroll 12
                for (std::size_t e = 0; e < entries; ++e)
                    part[e] = multiply_add(w, load<Vector<T>>(from + e * gradient_tile), part[e]);
            }
        }
#pragma GCC unroll 12
        for (std::size_t e = 0; e < entries; ++e) store(to + e * lanes<T>, part[e]);
    };
    const std::size_t row = entries * lanes<T>;
    for (std::size_t s = 0; s < 2; ++s) {
        if (!tile.side[s]) continue;
        T* const to = sums + s * (pose.handle_count + 1) * row;
        for (std::size_t k = 0; k < pose.handle_count; ++k) {
            add(tile.products[s], to + k * row, [&](std::size_t block, std::size_t lane) __attribute__((always_inline)) {
                const Weights<T>& weights = tile.weights[block];
                return load_weights<T>(weights.first + k * weights.stride + lane);
            });
        }
        add(tile.products[s], to + pose.handle_count * row,
            [&](std::size_t block, std::size_t lane) __attribute__((always_inline)) {
                return load<Vector<T>>(tile.remainder + block * block_size + lane);
            });
    }
}

// Writes the weight gradients (H, 16) of `count` vertices from vertex `i` on.
template <class T>
DFD_INLINE void write_weight_gradients(const PoseGradientJob<T>& job, const T* from, std::size_t i, std::size_t count)
{
    T* const to = job.weights + i * job.row_stride;
    if constexpr (sizeof(T) == sizeof(float)) {
        if (count == block_size && job.row_stride != 1)
            return lanes_to_rows(from, job.pose.handle_count, to, job.row_stride);
    }
    for (std::size_t k = 0; k < job.pose.handle_count; ++k)
        for (std::size_t lane = 0; lane < count; ++lane)
            to[lane * job.row_stride + k * job.column_stride] = from[k * block_size + lane];
}

template <class T>
DFD_INLINE void differentiate(const PoseGradientJob<T>& shared_job, std::size_t begin, std::size_t end, float* scratch,
                              double* table)
{
    const PoseGradientJob<T> job = shared_job;  // a local copy, so that stores cannot alias it
    const PoseJob<T>& pose = job.pose;
    const std::size_t rows = 2 * (pose.handle_count + 1) * entries;
    T* const sums = reinterpret_cast<T*>(scratch);
    Tile<T> tile;
    tile.products[0] = sums + rows * lanes<T>;
    tile.products[1] = tile.products[0] + entries * gradient_tile;
    tile.remainder = tile.products[1] + entries * gradient_tile;
    T* const weight_lanes = job.weights == nullptr ? nullptr : tile.remainder + gradient_tile;
    float* const packed = reinterpret_cast<float*>(tile.remainder + gradient_tile + block_size * pose.handle_count);
    if (job.transforms)
        for (std::size_t k = 0; k < rows * lanes<T>; ++k) sums[k] = T(0);

    const bool columns = pose.row_stride == 1;
    for (std::size_t start = begin; start < end; start += gradient_tile) {
        const std::size_t stop = end - start < gradient_tile ? end : start + gradient_tile;
        tile.side[0] = tile.side[1] = false;
        std::size_t block = 0;
        for (std::size_t i = start; i < stop; i += block_size, ++block) {
            const std::size_t count = stop - i < block_size ? stop - i : block_size;
            Weights<T>& weights = tile.weights[block] = {pose.weights + i, pose.column_stride};
            if (!columns || count < block_size) {
                float* const to = packed + block * block_size * pose.handle_count;
                if (columns) {
                    for (std::size_t k = 0; k < pose.handle_count; ++k)
                        for (std::size_t lane = 0; lane < block_size; ++lane)
                            to[k * block_size + lane] = lane < count ? pose.weights[i + lane + k * pose.column_stride] : 0;
                } else {
                    rows_to_lanes(pose.weights + i * pose.row_stride, pose.row_stride, pose.handle_count, count, to);
                }
                weights = {to, block_size};
            }
            const T *vertices = pose.vertices + 3 * i, *posed = job.posed + 3 * i;
            T* vertex_gradients = advanced(job.vertices, 3 * i);
            T padded[3][3 * block_size];
            if (count < block_size) {  // vertices with the gradient 0 add nothing
                for (std::size_t lane = 0; lane < 3 * block_size; ++lane) {
                    padded[0][lane] = vertices[lane < 3 * count ? lane : lane % 3];
                    padded[1][lane] = lane < 3 * count ? posed[lane] : T(0);
                }
                vertices = padded[0];
                posed = padded[1];
                if (vertex_gradients != nullptr) vertex_gradients = padded[2];
            }
            for (std::size_t lane = 0; lane < block_size; lane += lanes<T>)
                differentiate_lanes(job, {weights.first + lane, weights.stride}, vertices + 3 * lane, posed + 3 * lane,
                                    advanced(vertex_gradients, 3 * lane), advanced(weight_lanes, lane), tile,
                                    block * block_size + lane);
            if (count < block_size && vertex_gradients != nullptr)
                copy(padded[2], 3 * count, job.vertices + 3 * i);
            if (weight_lanes != nullptr) write_weight_gradients(job, weight_lanes, i, count);
        }
        if (job.transforms) add_products(pose, tile, block, sums);
    }
    if (!job.transforms) return;
    for (std::size_t k = 0; k < rows; ++k) {
        table[k] = 0;
        for (std::size_t lane = 0; lane < lanes<T>; ++lane) table[k] += static_cast<double>(sums[k * lanes<T> + lane]);
    }
}

}  // namespace

namespace DFD_VARIANT {

void pose_gradients_float(const PoseGradientJob<float>& job, std::size_t begin, std::size_t end, float* scratch,
                          double* table)
{
    differentiate(job, begin, end, scratch, table);
}

void pose_gradients_double(const PoseGradientJob<double>& job, std::size_t begin, std::size_t end, float* scratch,
                           double* table)
{
    differentiate(job, begin, end, scratch, table);
}

}  // namespace DFD_VARIANT
}  // namespace dfd
