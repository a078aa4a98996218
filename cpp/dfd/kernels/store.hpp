#pragma once

// Weights of a block of vertices, on their way to memory.

#include "dfd/kernels/distances.hpp"
#include "dfd/kernels/transpose.hpp"

namespace dfd {
namespace {

constexpr std::size_t column_ahead = 512;  // bytes of each column to prefetch

// The vertices of a block.
struct Place {
    std::size_t begin, count;
};

// Weights of a block for one handle, to its column.
DFD_INLINE void put_column(const BindJob& job, std::size_t handle, const Place& place, const Block& weights)
{
    float* column = job.weights + handle * job.column_stride + place.begin;
    if (place.count < block_size) {
        float padded[block_size];
        for (std::size_t part = 0; part < parts; ++part) store(padded + part * width, weights.part[part]);
        copy(padded, place.count, column);
    } else if (job.stream) {
        for (std::size_t part = 0; part < parts; ++part) stream(column + part * width, weights.part[part]);
    } else {
        prefetch<true>(column, column_ahead, 1);
        for (std::size_t part = 0; part < parts; ++part) store(column + part * width, weights.part[part]);
    }
}

// Rows that follow one another, on their way past the caches: what does not fill a line waits for the next block.
class LineStream {
public:
    LineStream(float* to, float* buffer)
        : skip_(reinterpret_cast<std::uintptr_t>(to) % 64 / sizeof(float)), pending_(skip_), line_(to - skip_),
          buffer_(buffer)
    {
    }

    // Where the next entries belong before they are pushed.
    float* place() const { return buffer_ + pending_; }

    DFD_INLINE void push(std::size_t count)
    {
        const std::size_t filled = pending_ + count;
        std::size_t k = 0;
        if (skip_ != 0 && filled >= block_size) {  // the first line belongs in part to others
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
    std::size_t skip_, pending_;  // entries of the line that are another's, and that are taken
    float *line_, *buffer_;
};

// Weights (H, 16) of a block, to the rows of its vertices.
DFD_INLINE void put_rows(const BindJob& job, const Place& place, const float* weights, LineStream& lines)
{
    float* rows = job.weights + place.begin * job.row_stride;
    if (job.stream) {
        lanes_to_rows(weights, job.handle_count, lines.place(), job.handle_count);
        lines.push(place.count * job.handle_count);
    } else if (place.count == block_size) {
        lanes_to_rows(weights, job.handle_count, rows, job.row_stride);
    } else {
        for (std::size_t lane = 0; lane < place.count; ++lane)
            for (std::size_t j = 0; j < job.handle_count; ++j)
                rows[lane * job.row_stride + j] = weights[j * block_size + lane];
    }
}

}  // namespace
}  // namespace dfd
