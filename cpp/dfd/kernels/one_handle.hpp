#pragma once

// Eq. (4-5) for a single handle with the paper's settings: features are read once, and need no scratch memory. All bits
// of a weight equal those of the computation for several handles.

#include "dfd/kernels/distances.hpp"
#include "dfd/kernels/layout.hpp"

namespace dfd {
namespace {

// The entries of a block of rows (16, D) of floats.
class RowBlock {
public:
    static constexpr std::size_t entry_bytes = sizeof(float), blocks_ahead = 1;
    // With AVX-512, a block of 384 floats took 1.1 times as long as with `rows_to_lanes`, and one of 64 floats 0.6 times.
    static constexpr std::size_t widest = width == 16 ? 128 : SIZE_MAX;

    RowBlock(const BindJob& job, std::size_t begin, std::size_t ahead)
        : rows_(static_cast<const float*>(job.features) + begin * job.dimension), dimension_(job.dimension),
          ahead_(ahead)
    {
    }

    // Loads entries k, k + 1, … of the vertices in one part of the block: `width` entries, or only `count`.
    template <bool Whole>
    DFD_INLINE void load_entries(std::size_t k, std::size_t part, std::size_t count, Float (&entries)[width]) const
    {
#pragma GCC unroll 16
        for (std::size_t i = 0; i < width; ++i) {
            const float* from = rows_ + (part * width + i) * dimension_ + k;
            entries[i] = Whole ? load<Float>(from) : load_part(from, count);
        }
        transpose(entries);
    }

    // Prefetches as many bytes as `width` entries of the block have. The hardware does not prefetch sixteen streams of
    // rows, so the bytes are prefetched in the order of memory, beyond the next block.
    DFD_INLINE void prefetch_entries(std::size_t k) const
    {
        prefetch(rows_ + k * block_size, ahead_, block_size * width * sizeof(float));
    }

private:
    const float* rows_;
    std::size_t dimension_, ahead_;
};

// The entries of a block (D, 16) of float16.
class HalfBlock {
public:
    static constexpr std::size_t entry_bytes = sizeof(std::uint16_t), blocks_ahead = 0, widest = SIZE_MAX;

    HalfBlock(const BindJob& job, std::size_t begin, std::size_t ahead)
        : halves_(static_cast<const std::uint16_t*>(job.features) + begin * job.dimension), ahead_(ahead)
    {
    }

    template <bool Whole>
    DFD_INLINE void load_entries(std::size_t k, std::size_t part, std::size_t count, Float (&entries)[width]) const
    {
#pragma GCC unroll 16
        for (std::size_t i = 0; i < width; ++i) {
            if (!Whole && i >= count) break;
            entries[i] = from_halves(halves_ + (k + i) * block_size + part * width);
        }
    }

    DFD_INLINE void prefetch_entries(std::size_t k) const
    {
        prefetch(halves_ + k * block_size, ahead_, block_size * width * sizeof *halves_);
    }

private:
    const std::uint16_t* halves_;
    std::size_t ahead_;
};

// Calls `add(sum, k, entries)` for `count` entries from k = `begin` on, of the vertices in one part of a block. `sum`
// is the index of the partial sum to which `sum_of` adds entry k.
template <bool Whole, class FloatBlock, class Add>
DFD_INLINE void visit(const FloatBlock& block, std::size_t begin, std::size_t count, std::size_t part, const Add& add)
{
    Float entries[width];
    block.template load_entries<Whole>(begin, part, count, entries);
#pragma GCC unroll 16
    for (std::size_t i = 0; i < width; ++i) {
        if (Whole || i < count / 4 * 4) add(i % 4, begin + i, entries[i]);
        else if (i < count) add(0, begin + i, entries[i]);
    }
}

// Returns the squared distances from one part of a block to the handle, from the differences of the entries.
template <class FloatBlock>
__attribute__((noinline)) Float squared_differences(const BindJob& job, const FloatBlock& block, std::size_t part)
{
    Float sums[4] = {};
    const auto add = [&](std::size_t sum, std::size_t k, Float entry) __attribute__((always_inline)) {
        const Float difference = entry - splat(job.points.rows[k * group_size]);
        sums[sum] = multiply_add(difference, difference, sums[sum]);
    };
    const std::size_t left = job.dimension % width, whole = job.dimension - left;
    for (std::size_t k = 0; k < whole; k += width) visit<true>(block, k, width, part, add);
    if (left > 0) visit<false>(block, whole, left, part, add);
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// Computes the squared distances from a block to the handle as `FloatPanel` does, in the same order of operations.
// Returns whether a feature is perhaps infinite or NaN.
template <class FloatBlock>
DFD_INLINE bool float_squares(const BindJob& job, const FloatBlock& block, Block& out)
{
    Float totals[parts] = {}, squares[parts][4] = {};
    for (std::size_t start = 0; start < job.dimension; start += chunk) {
        const std::size_t end = start + chunk < job.dimension ? start + chunk : job.dimension;
        const std::size_t left = (end - start) % width, whole = end - left;
        Float products[parts] = {};
        const auto add_to = [&](std::size_t part) __attribute__((always_inline)) {
            return [&, part](std::size_t sum, std::size_t k, Float entry) __attribute__((always_inline)) {
                squares[part][sum] = multiply_add(entry, entry, squares[part][sum]);
                products[part] = multiply_add(entry, splat(job.points.rows[k * group_size]), products[part]);
            };
        };
        for (std::size_t k = start; k < whole; k += width) {
            block.prefetch_entries(k);
#pragma GCC unroll 4
            for (std::size_t part = 0; part < parts; ++part) visit<true>(block, k, width, part, add_to(part));
        }
        if (left > 0) {
#pragma GCC unroll 4
            for (std::size_t part = 0; part < parts; ++part) visit<false>(block, whole, left, part, add_to(part));
        }
        for (std::size_t part = 0; part < parts; ++part) totals[part] += products[part];
    }
    bool suspect = false;
    for (std::size_t part = 0; part < parts; ++part) {
        const Float square = (squares[part][0] + squares[part][1]) + (squares[part][2] + squares[part][3]);
        suspect |= any_infinite(square);
        const Float both = square + splat(job.points.squares[0]);
        const Float distance = squared_distance(both, totals[part], [&]() __attribute__((always_inline)) {
            return squared_differences(job, block, part);
        });
        out.part[part] = distance + splat(job.points.offsets[0]);
    }
    return suspect;
}

// Computes the weights of the first vertices of a range, up to a multiple of `Blocks` blocks, and returns the number of
// these vertices. `measure(begin, ahead, squares)` computes the squared distances of the blocks from vertex `begin` on,
// and prefetches `ahead` bytes ahead, which is beyond the next `skipped` blocks of `block_bytes` bytes. At the end of the
// features, `ahead` is 0, because prefetches of addresses without memory take long.
template <std::size_t Blocks, class Measure>
DFD_INLINE std::size_t bind_blocks_of_one(const BindJob& job, std::size_t begin, std::size_t end,
                                          std::size_t block_bytes, std::size_t skipped, const Measure& measure)
{
    const std::size_t count = (end - begin) / (Blocks * block_size) * (Blocks * block_size);
    const std::size_t ahead = skipped * block_bytes + single_ahead;
    const std::size_t margin = (ahead / block_bytes + Blocks + 1) * block_size;
    for (std::size_t i = begin; i < begin + count; i += Blocks * block_size) {
        Block squares[Blocks];
        measure(i, i + margin <= job.vertex_count ? ahead : 0, squares);
        for (std::size_t block = 0; block < Blocks; ++block)
            for (std::size_t part = 0; part < parts; ++part)
                store(job.weights + i + block * block_size + part * width,
                      maximum(1.0f - sqrt(squares[block].part[part]), splat(0.0f)));
    }
    return count;
}

// The weights of the first vertices of a range: their number, and the faults of their features.
struct FirstWeights {
    std::size_t count;
    unsigned faults;
};

// These functions are not inlined, because the compiler would then optimize the code for several handles less.
template <class FloatBlock>
__attribute__((noinline)) FirstWeights bind_one_float(const BindJob& shared_job, std::size_t begin, std::size_t end)
{
    if (shared_job.dimension > FloatBlock::widest) return {0, no_fault};
    const BindJob job = shared_job;  // a local copy, so that stores cannot alias it
    bool suspect = false;
    const std::size_t bytes = job.dimension * block_size * FloatBlock::entry_bytes;
    const std::size_t count = bind_blocks_of_one<1>(
        job, begin, end, bytes, FloatBlock::blocks_ahead,
        [&](std::size_t i, std::size_t ahead, Block* squares) __attribute__((always_inline)) {
        suspect |= float_squares(job, FloatBlock(job, i, ahead), *squares);
    });
    return {count, suspect ? features_suspect : no_fault};
}

__attribute__((noinline)) FirstWeights bind_one_bytes(const BindJob& shared_job, std::size_t begin, std::size_t end)
{
    constexpr std::size_t together = 2;  // more blocks would be read in an order that slows down the hardware
    const BindJob job = shared_job;
    const auto* bytes = static_cast<const std::uint8_t*>(job.features);
    const std::size_t count = bind_blocks_of_one<together>(
        job, begin, end, (job.dimension + 4) * block_size, 0,
        [&](std::size_t i, std::size_t ahead, Block* squares) __attribute__((always_inline)) {
        const BytePanel<together> panel(bytes + i * (job.dimension + 4), job.dimension, job.scale, ahead);
        panel.template squared_distances<1>(job.points, 0, squares);
    });
    return {count, no_fault};
}

}  // namespace
}  // namespace dfd
