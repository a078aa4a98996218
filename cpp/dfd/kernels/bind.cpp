// Computes Eq. (4-7) for blocks of vertices, one vertex per vector lane. The operations for a weight and their order
// depend neither on the index of the vertex nor on other handles.

#include "dfd/kernels/distances.hpp"
#include "dfd/kernels/falloff.hpp"
#include "dfd/kernels/layout.hpp"
#include "dfd/kernels/one_handle.hpp"

namespace dfd {
namespace {

constexpr std::size_t blocks_ahead = 4;       // features are prefetched this many blocks before they are read
constexpr std::size_t geodesic_ahead = 1024;  // geodesic distances are prefetched this many bytes ahead
constexpr std::size_t column_ahead = 512;     // columns of weights are prefetched this many bytes ahead

// A tile has this many points (handles or fixed points). The sums for the distances to these points fit into registers.
#if defined(__AVX512F__)
constexpr std::size_t tile = 16;
#elif defined(__AVX2__) || defined(__ARM_NEON)
constexpr std::size_t tile = 4;
#else
constexpr std::size_t tile = 2;
#endif
static_assert(group_size % tile == 0);

// Computes the squared distances to `wanted` points, beginning with `first`. An odd `wanted` above 1 is rounded up.
template <std::size_t Count, class Panel>
DFD_INLINE void measure(const Panel& panel, const PackedRows& points, std::size_t first, std::size_t wanted,
                        Block* squares)
{
    if constexpr (Count < tile) {
        if (wanted > Count) return measure<Count == 1 ? 2 : Count + 2>(panel, points, first, wanted, squares);
    }
    panel.template squared_distances<Count>(points, first, squares);
}

// The vertices of one block: `count` vertices, beginning with `begin`.
struct Range {
    std::size_t begin, count;
};

DFD_INLINE void put_column(const BindJob& job, std::size_t handle, const Range& block, const Block& weights)
{
    float* column = job.weights + handle * job.column_stride + block.begin;
    if (block.count < block_size) {
        float padded[block_size];
        for (std::size_t part = 0; part < parts; ++part) store(padded + part * width, weights.part[part]);
        copy(padded, block.count, column);
    } else if (job.stream) {
        for (std::size_t part = 0; part < parts; ++part) stream(column + part * width, weights.part[part]);
    } else {
        prefetch<true>(column, column_ahead, 1);
        for (std::size_t part = 0; part < parts; ++part) store(column + part * width, weights.part[part]);
    }
}

// Writes contiguous rows to memory as whole cache lines, past the caches. A buffer keeps entries until a line is full.
class LineStream {
public:
    LineStream(float* to, float* buffer)
        : skip_(reinterpret_cast<std::uintptr_t>(to) % 64 / sizeof(float)), pending_(skip_), line_(to - skip_),
          buffer_(buffer)
    {
    }

    // Returns the address at which the caller must write the next entries before it calls `push`.
    float* next() const { return buffer_ + pending_; }

    DFD_INLINE void push(std::size_t count)
    {
        const std::size_t filled = pending_ + count;
        std::size_t k = 0;
        if (skip_ != 0 && filled >= block_size) {  // the first line is shared with another range
            copy(buffer_ + skip_, block_size - skip_, line_ + skip_);
            skip_ = 0;
            k = block_size;
        }
        for (; k + block_size <= filled; k += block_size)
            for (std::size_t part = 0; part < block_size; part += width)
                stream(line_ + k + part, load<Float>(buffer_ + k + part));
        for (std::size_t part = 0; part < block_size; part += width)
            store(buffer_ + part, load<Float>(buffer_ + k + part));
        line_ += k;
        pending_ = filled - k;
    }

    void finish() const { copy(buffer_ + skip_, pending_ - skip_, line_ + skip_); }

private:
    std::size_t skip_;     // entries of the first line that belong to another range
    std::size_t pending_;  // filled entries of the buffer, including the skipped ones
    float *line_, *buffer_;
};

// Writes the weights (H, 16) of a block to the rows of its vertices.
DFD_INLINE void put_rows(const BindJob& job, const Range& block, const float* weights, LineStream& lines)
{
    float* rows = job.weights + block.begin * job.row_stride;
    if (job.stream) {
        lanes_to_rows(weights, job.handle_count, lines.next(), job.handle_count);
        lines.push(block.count * job.handle_count);
    } else if (block.count == block_size) {
        lanes_to_rows(weights, job.handle_count, rows, job.row_stride);
    } else {
        for (std::size_t lane = 0; lane < block.count; ++lane)
            for (std::size_t j = 0; j < job.handle_count; ++j)
                rows[lane * job.row_stride + j] = weights[j * block_size + lane];
    }
}

// Evidence of invalid input in a range of vertices.
struct Faults {
    bool suspect = false;      // whether a feature is perhaps infinite or NaN
    Bits largest[parts] = {};  // the largest geodesic distances, compared as unsigned integers

    unsigned bits() const
    {
        const float limit = 1.0f + geodesic_slack;
        std::uint32_t limit_bits;
        std::memcpy(&limit_bits, &limit, sizeof limit);
        unsigned result = suspect ? features_suspect : no_fault;
        for (std::size_t part = 0; part < parts; ++part)
            for (std::size_t lane = 0; lane < width; ++lane)
                if (largest[part][lane] > limit_bits) result |= geodesic_suspect;
        return result;
    }
};

// Multiplies the weights of one handle by (1 - g)^λ for the geodesic distances g, as in Eq. (7).
DFD_INLINE void localize(const BindJob& job, std::size_t handle, const Range& block, Block& weights, Faults& faults)
{
    const float* distances = job.geodesic + handle * job.vertex_count + block.begin;
    prefetch(distances, geodesic_ahead, 1);  // the hardware does not prefetch so many streams, one per handle
    float padded[block_size];
    if (block.count < block_size) {
        for (std::size_t lane = 0; lane < block_size; ++lane) padded[lane] = lane < block.count ? distances[lane] : 0;
        distances = padded;
    }
    const auto [exponent, products] = job.powers[handle];
    for (std::size_t part = 0; part < parts; ++part) {
        const Float g = load<Float>(distances + part * width);
        // As unsigned integers, the bits of negative numbers and NaN exceed those of all valid distances.
        faults.largest[part] = (Bits)g > faults.largest[part] ? (Bits)g : faults.largest[part];
        const Float x = minimum(maximum(1.0f - g, splat(0.0f)), splat(1.0f));
        if (products < 0) {
            weights.part[part] *= power_of(x, exponent);
        } else {
#pragma GCC unroll 1
            for (int k = 0; k < products; ++k) weights.part[part] *= x;
        }
    }
}

// Writes the weights of one handle to their column, or to scratch memory if the result has contiguous rows instead.
template <bool Columns>
DFD_INLINE void put(const BindJob& job, std::size_t handle, const Range& block, const Block& weights, float* scratch)
{
    if constexpr (Columns) {
        put_column(job, handle, block, weights);
    } else {
        for (std::size_t part = 0; part < parts; ++part)
            store(scratch + handle * block_size + part * width, weights.part[part]);
    }
}

DFD_INLINE Block ones()
{
    Block block;
    for (std::size_t part = 0; part < parts; ++part) block.part[part] = splat(1.0f);
    return block;
}

// Computes the weights of a block. `Columns` is true if the columns of weights are contiguous, and `Local` if there are
// geodesic distances. Both are template parameters, because a branch for each handle of each block would take time.
template <bool Columns, bool Local, class Panel>
DFD_INLINE void bind_block(const BindJob& job, const Panel& panel, const Range& block, float* scratch, Faults& faults)
{
    Block limit = ones();  // largest possible weight of a handle: 1 minus the largest weight of the fixed points
    for (std::size_t first = 0; first < job.points.count; first += tile) {
        const std::size_t count = job.points.count - first < tile ? job.points.count - first : tile;
        Block squares[tile];
        measure<1>(panel, job.points, first, count, squares);
        std::size_t j = 0;
        if (first < job.fixed_count) {  // the nearest fixed point has the largest weight, so one square root is enough
            for (; j < count && first + j < job.fixed_count; ++j)
                for (std::size_t part = 0; part < parts; ++part)
                    limit.part[part] = minimum(limit.part[part], squares[j].part[part]);
            if (first + j == job.fixed_count)
                for (std::size_t part = 0; part < parts; ++part) limit.part[part] = sqrt(limit.part[part]);
        }
        for (; j < count; ++j) {
            const std::size_t handle = first + j - job.fixed_count;
            Block weights;
            for (std::size_t part = 0; part < parts; ++part) {
                // Square root instructions have a low throughput, so every second root is computed by products.
                const Float square = squares[j].part[part];
                const Float distance = j % 2 == 0 ? sqrt(square) : sqrt_by_products(square);
                weights.part[part] = maximum(limit.part[part] - distance, splat(0.0f));  // Equations (4-6)
            }
            if constexpr (Local) localize(job, handle, block, weights, faults);
            put<Columns>(job, handle, block, weights, scratch);
        }
    }
}

// Computes the weights of a block for handles of any reach and falloff, for regions, and for fixed points of any
// strength. If all of these have the paper's values, all bits of the result equal those of `bind_block`.
template <bool Columns, class Panel>
DFD_INLINE void bind_general_block(const BindJob& job, const Panel& panel, const Range& block, float* scratch,
                                  Faults& faults)
{
    Block limit = ones();
    Block nearest;  // smallest squared distance to the members of a handle so far
    std::size_t handle = 0, member = 0;
    for (std::size_t first = 0; first < job.points.count; first += tile) {
        const std::size_t count = job.points.count - first < tile ? job.points.count - first : tile;
        Block squares[tile];
        measure<1>(panel, job.points, first, count, squares);
        for (std::size_t j = 0; j < count; ++j) {
            if (first + j < job.fixed_count) {
                const Float strength = splat(job.strengths[first + j]), unfixed = splat(1.0f) - strength;
                for (std::size_t part = 0; part < parts; ++part)
                    limit.part[part] = minimum(limit.part[part], strength * sqrt(squares[j].part[part]) + unfixed);
                continue;
            }
            for (std::size_t part = 0; part < parts; ++part)
                nearest.part[part] =
                    member == 0 ? squares[j].part[part] : minimum(nearest.part[part], squares[j].part[part]);
            if (++member < job.members[handle]) continue;
            member = 0;
            const auto [inverse, falloff] = job.reaches[handle];
            Block weights;
            for (std::size_t part = 0; part < parts; ++part) {
                const Float distance = sqrt(nearest.part[part]) * splat(inverse), top = limit.part[part];
                weights.part[part] =
                    falloff == Falloff::linear
                        ? maximum(top - distance, splat(0.0f))
                        : maximum(fall_off(maximum(1.0f - distance, splat(0.0f)), falloff) - (1.0f - top), splat(0.0f));
            }
            if (job.geodesic != nullptr) localize(job, handle, block, weights, faults);
            put<Columns>(job, handle, block, weights, scratch);
            ++handle;
        }
    }
}

template <bool Columns, bool Local, bool General, class Read>
DFD_INLINE unsigned bind_blocks(const BindJob& shared_job, std::size_t begin, std::size_t end, float* scratch,
                                const Read& read)
{
    const BindJob job = shared_job;  // a local copy, so that stores cannot alias it
    float* weights = scratch + job.dimension * block_size;
    const bool by_lines = !Columns && job.stream;
    LineStream lines(by_lines ? job.weights + begin * job.row_stride : nullptr, weights + job.handle_count * block_size);
    Faults faults;
    for (std::size_t i = begin; i < end; i += block_size) {
        const Range block{i, end - i < block_size ? end - i : block_size};
        const auto panel = read(job, i, block.count, scratch);
        faults.suspect |= panel.suspect();
        if constexpr (General) bind_general_block<Columns>(job, panel, block, weights, faults);
        else bind_block<Columns, Local>(job, panel, block, weights, faults);
        if constexpr (!Columns) put_rows(job, block, weights, lines);
    }
    if (by_lines) lines.finish();
    stream_fence();
    return faults.bits();
}

template <bool Columns, class Read>
DFD_INLINE unsigned dispatch(const BindJob& job, std::size_t begin, std::size_t end, float* scratch, const Read& read)
{
    if (job.general) return bind_blocks<Columns, true, true>(job, begin, end, scratch, read);
    if (job.geodesic == nullptr) return bind_blocks<Columns, false, false>(job, begin, end, scratch, read);
    return bind_blocks<Columns, true, false>(job, begin, end, scratch, read);
}

// Computes the weights of a range. `read(job, first vertex, count, scratch)` returns the features of a block (a panel).
// If there is one handle with the paper's settings, `first` computes all weights but those of a last group of blocks.
template <class Read>
DFD_INLINE unsigned bind_range(const BindJob& job, std::size_t begin, std::size_t end, float* scratch,
                               FirstWeights (*first)(const BindJob&, std::size_t, std::size_t), const Read& read)
{
    const bool columns = job.row_stride == 1 && (job.column_stride != 1 || job.handle_count == 1);
    const bool single = columns && job.points.count == 1 && !job.general && job.geodesic == nullptr;
    const auto [count, faults] = single ? first(job, begin, end) : FirstWeights{0, no_fault};
    begin += count;
    return faults | (columns ? dispatch<true>(job, begin, end, scratch, read)
                             : dispatch<false>(job, begin, end, scratch, read));
}

}  // namespace

namespace DFD_VARIANT {

unsigned bind_rows(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch, bind_one_float<RowBlock>,
                      [](const BindJob& own, std::size_t i, std::size_t count, float* panel) __attribute__((always_inline)) {
        const float* rows = static_cast<const float*>(own.features) + i * own.dimension;
        rows_to_lanes(rows, own.dimension, own.dimension, count, panel);
        return FloatPanel(panel, own.dimension);
    });
}

unsigned bind_halves(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch, bind_one_float<HalfBlock>,
                      [](const BindJob& own, std::size_t i, std::size_t, float* panel) __attribute__((always_inline)) {
        const std::size_t size = own.dimension * block_size;
        const std::uint16_t* halves = static_cast<const std::uint16_t*>(own.features) + i * own.dimension;
        prefetch(halves, blocks_ahead * size * sizeof *halves, size * sizeof *halves);
        for (std::size_t k = 0; k < size; k += width) store(panel + k, from_halves(halves + k));
        return FloatPanel(panel, own.dimension);
    });
}

unsigned bind_bytes(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch, bind_one_bytes,
                      [](const BindJob& own, std::size_t i, std::size_t, float*) __attribute__((always_inline)) {
        const std::uint8_t* bytes = static_cast<const std::uint8_t*>(own.features) + i * (own.dimension + 4);
        const std::size_t size = (own.dimension + 4) * block_size;
        prefetch(bytes, blocks_ahead * size, size);
        return BytePanel<>(bytes, own.dimension, own.scale);
    });
}

}  // namespace DFD_VARIANT
}  // namespace dfd
