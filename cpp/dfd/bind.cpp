#include "dfd/bind.hpp"

#include "dfd/parallel.hpp"
#include "dfd/require.hpp"
#include "dfd/scratch.hpp"

#include <atomic>
#include <cmath>
#include <vector>

namespace dfd {
namespace {

constexpr std::size_t grain_entries = std::size_t{1} << 19;   // of features, compared: less is not worth a thread
constexpr std::size_t streamed_bytes = std::size_t{1} << 24;  // results beyond this would only wash out the caches

// Points rearranged in groups of 16, and the targets that refer to them.
class PackedPoints {
public:
    PackedPoints(const Points& points, const Features& features)
    {
        const auto& [rows, offsets] = points;
        const std::size_t groups = (rows.rows + group_size - 1) / group_size, padded = groups * group_size;
        offsets_.assign(padded, 0.0f);
        std::copy(offsets.begin(), offsets.end(), offsets_.begin());
        if (features.layout == Features::Layout::bytes) pack_bytes(rows, groups);
        else pack_floats(rows, groups);
        targets = {rows_.data(), squares_.data(), quads_.data(), quad_squares_.data(), offsets_.data(), rows.rows};
    }

    PackedPoints(const PackedPoints&) = delete;
    PackedPoints& operator=(const PackedPoints&) = delete;

    Targets targets;

private:
    void pack_floats(const Matrix<const float>& rows, std::size_t groups)
    {
        rows_.assign(groups * rows.columns * group_size, 0.0f);
        squares_.assign(groups * group_size, 0.0f);
        for (std::size_t j = 0; j < rows.rows; ++j) {
            double square = 0;
            float* to = rows_.data() + j / group_size * rows.columns * group_size + j % group_size;
            for (std::size_t k = 0; k < rows.columns; ++k) {
                to[k * group_size] = rows.row(j)[k];
                square += double(rows.row(j)[k]) * double(rows.row(j)[k]);
            }
            squares_[j] = static_cast<float>(square);
        }
    }

    void pack_bytes(const Matrix<const float>& rows, std::size_t groups)
    {
        quads_.assign(groups * rows.columns / 4 * group_size, 0);
        quad_squares_.assign(groups * group_size, 0);
        for (std::size_t j = 0; j < rows.rows; ++j) {
            std::int32_t square = 0, sum = 0;
            std::int32_t* to = quads_.data() + j / group_size * (rows.columns / 4) * group_size + j % group_size;
            for (std::size_t k = 0; k < rows.columns; ++k) {
                const auto entry = static_cast<std::int32_t>(std::lround(rows.row(j)[k]));
                require(entry >= -127 && entry <= 127, "bind: entries of bytes must lie within ±127");
                square += entry * entry;
                sum += entry;
                auto& quad = to[k / 4 * group_size];
                quad = static_cast<std::int32_t>(static_cast<std::uint32_t>(quad) |
                                                 (static_cast<std::uint32_t>(entry & 255) << (k % 4 * 8)));
            }
            quad_squares_[j] = square + 256 * sum;  // the vertices' entries carry an offset of 128
        }
    }

    std::vector<float> rows_, squares_, offsets_;
    std::vector<std::int32_t> quads_, quad_squares_;
};

void check_points(const Points& points, const Features& features, const char* name, const char* width_message)
{
    require(points.rows.rows == 0 || points.rows.columns == features.dimension, width_message);
    require(points.offsets.empty() || points.offsets.size() == points.rows.rows,
            "bind: every handle and fixed point needs an offset, or none");
    require_finite(points.rows, "bind", name);
}

BindRange range_of(const Kernels& kernels, Features::Layout layout)
{
    switch (layout) {
    case Features::Layout::halves: return kernels.bind_halves;
    case Features::Layout::bytes: return kernels.bind_bytes;
    default: return kernels.bind_rows;
    }
}

// Only whole lines leave past the caches: those of rows that follow one another, or of columns that start with one.
bool can_stream(const StridedMatrix<float>& weights)
{
    const bool aligned = reinterpret_cast<std::uintptr_t>(weights.data) % 64 == 0;
    if (weights.columns == 1) return aligned && weights.row_stride == 1;
    if (weights.column_stride == 1) return weights.row_stride == weights.columns;
    return aligned && weights.column_stride % 16 == 0;
}

[[noreturn]] void throw_geodesic(const Matrix<const float>& geodesic)
{
    const std::span<const float> all{geodesic.data, geodesic.rows * geodesic.columns};
    const auto found = std::find_if(all.begin(), all.end(), [](float g) { return !(g >= 0 && g <= 1); });
    const auto index = static_cast<std::size_t>(found - all.begin());
    throw std::invalid_argument("bind: `geodesic` must lie in [0, 1], got " + std::to_string(*found) + " at [" +
                                std::to_string(index / geodesic.columns) + ", " +
                                std::to_string(index % geodesic.columns) + "]");
}

}  // namespace

void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels)
{
    const auto& [fixed, geodesic, locality] = constraints;
    check_points(handles, features, "handles", "bind: `handles` and `features` differ in dimension");
    check_points(fixed, features, "fixed", "bind: `fixed` and `features` differ in dimension");
    require(weights.rows == features.vertex_count && weights.columns == handles.rows.rows,
            "bind: `weights` must be (V, H)");
    require(weights.rows * weights.columns == 0 || weights.row_stride == 1 || weights.column_stride == 1,
            "bind: `weights` must have contiguous rows or columns");
    require(locality.empty() || (locality.size() == handles.rows.rows && geodesic.rows == handles.rows.rows &&
                                 geodesic.columns == features.vertex_count),
            "bind: `geodesic` must be (H, V) and `locality` (H)");
    for (const float exponent : locality)
        require(std::isfinite(exponent) && exponent >= 0, "bind: `locality` must be finite and at least 0");

    const PackedPoints packed_handles(handles, features), packed_fixed(fixed, features);
    BindJob job;
    job.features = features.data;
    job.vertex_count = features.vertex_count;
    job.dimension = features.dimension;
    job.scale = features.scale;
    job.fixed = packed_fixed.targets;
    job.handles = packed_handles.targets;
    job.geodesic = locality.empty() ? nullptr : geodesic.data;
    job.locality = locality.data();
    job.weights = weights.data;
    job.row_stride = weights.row_stride;
    job.column_stride = weights.column_stride;
    job.stream = weights.rows * weights.columns * sizeof(float) >= streamed_bytes && can_stream(weights);

    const Scratch scratch(threads, bind_scratch(features.dimension, handles.rows.rows));
    const BindRange bind_range = range_of(kernels, features.layout);
    std::atomic<unsigned> faults = no_fault;
    const std::size_t compared = features.dimension * (handles.rows.rows + fixed.rows.rows + 1) + 1;
    const std::size_t grain = (grain_entries / compared / block_size + 1) * block_size;
    parallel_ranges(features.vertex_count, grain, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
        faults |= bind_range(job, begin, end, scratch.of(worker));
    });
    // Finite features whose length overflows are only far from everything; the slow check tells them apart.
    if ((faults & features_suspect) != 0 && features.layout == Features::Layout::rows)
        require_finite(Matrix<const float>{static_cast<const float*>(features.data), features.vertex_count,
                                           features.dimension},
                       "bind", "features");
    require((faults & features_suspect) == 0 || features.layout != Features::Layout::halves,
            "bind: `features` must be finite");
    if ((faults & geodesic_invalid) != 0) throw_geodesic(geodesic);
}

}  // namespace dfd
