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
constexpr std::size_t streamed_bytes = std::size_t{1} << 22;  // results beyond this would only wash out the caches
constexpr std::size_t streamed_columns = 64;
constexpr std::size_t most_byte_dimensions = 33'000;          // beyond, 32 bits may not hold a squared distance

double value_of(float value) { return double(value); }

double value_of(std::uint16_t half)
{
    const int exponent = half >> 10 & 31, fraction = half & 1023;
    const double magnitude = exponent == 31  ? (fraction == 0 ? INFINITY : NAN)
                             : exponent == 0 ? std::ldexp(fraction, -24)
                                             : std::ldexp(1024 + fraction, exponent - 25);
    return (half & 0x8000) == 0 ? magnitude : -magnitude;
}

// The features (D) of a vertex, in steps for bytes.
void read_row(const Features& features, std::size_t vertex, std::span<float> row)
{
    const std::size_t dimension = row.size(), block = vertex / block_size, lane = vertex % block_size;
    if (features.layout == Features::Layout::rows) {
        const auto* from = static_cast<const float*>(features.data) + vertex * dimension;
        std::copy_n(from, dimension, row.begin());
    } else if (features.layout == Features::Layout::halves) {
        const auto* from = static_cast<const std::uint16_t*>(features.data) + block * block_size * dimension + lane;
        for (std::size_t k = 0; k < dimension; ++k) row[k] = static_cast<float>(value_of(from[k * block_size]));
    } else {
        const auto* from = static_cast<const std::uint8_t*>(features.data) + block * block_size * (dimension + 4);
        for (std::size_t k = 0; k < dimension; ++k)
            row[k] = static_cast<float>(from[(k / 4 * block_size + lane) * 4 + k % 4] - 128);
    }
}

// Fixed points and handles, in this order, rearranged in groups of 16.
class PackedPoints {
public:
    PackedPoints(const Points& fixed, const Points& handles, const Features& features)
        : dimension_(features.dimension)
    {
        const std::size_t count = fixed.count() + handles.count();
        const std::size_t padded = (count + group_size - 1) / group_size * group_size;
        const bool bytes = features.layout == Features::Layout::bytes;
        offsets_.assign(padded, 0.0f);
        if (bytes) {
            quads_.assign(padded * dimension_ / 4, 0);
            pairs_.assign(2 * quads_.size(), 0);
            quad_squares_.assign(padded, 0);
        } else {
            rows_.assign(padded * dimension_, 0.0f);
            squares_.assign(padded, 0.0f);
        }
        std::vector<float> stored(dimension_);
        std::size_t next = 0;
        for (const Points* points : {&fixed, &handles}) {
            std::copy(points->offsets.begin(), points->offsets.end(), offsets_.begin() + std::ptrdiff_t(next));
            for (std::size_t j = 0; j < points->count(); ++j, ++next) {
                if (!points->vertices.empty()) read_row(features, static_cast<std::size_t>(points->vertices[j]), stored);
                const std::span<const float> row = points->vertices.empty() ? points->rows.row(j) : stored;
                if (bytes) pack_bytes(row, next);
                else pack_floats(row, next);
            }
        }
        targets = {rows_.data(),  squares_.data(),      quads_.data(),
                   pairs_.data(), quad_squares_.data(), offsets_.data(), count};
    }

    PackedPoints(const PackedPoints&) = delete;
    PackedPoints& operator=(const PackedPoints&) = delete;

    Targets targets;

private:
    void pack_floats(std::span<const float> row, std::size_t j)
    {
        double square = 0;
        float* to = rows_.data() + j / group_size * dimension_ * group_size + j % group_size;
        for (std::size_t k = 0; k < dimension_; ++k) {
            to[k * group_size] = row[k];
            square += double(row[k]) * double(row[k]);
        }
        squares_[j] = static_cast<float>(square);
    }

    void pack_bytes(std::span<const float> row, std::size_t j)
    {
        std::int32_t square = 0, sum = 0;
        const std::size_t group = j / group_size * (dimension_ / 4);
        for (std::size_t k = 0; k < dimension_; ++k) {
            const auto entry = static_cast<std::int32_t>(std::lround(row[k]));
            require(entry >= -127 && entry <= 127, "bind: entries of bytes must lie within ±127");
            square += entry * entry;
            sum += entry;
            const std::size_t quad = group + k / 4, lane = j % group_size;
            put(quads_[quad * group_size + lane], entry & 0xff, k % 4 * 8);
            put(pairs_[(2 * quad + k % 2) * group_size + lane], entry & 0xffff, k % 4 / 2 * 16);
        }
        quad_squares_[j] = square + 256 * sum;  // the vertices' entries carry an offset of 128
    }

    static void put(std::int32_t& word, std::int32_t bits, std::size_t shift)
    {
        word = static_cast<std::int32_t>(static_cast<std::uint32_t>(word) | static_cast<std::uint32_t>(bits) << shift);
    }

    std::size_t dimension_;
    std::vector<float> rows_, squares_, offsets_;
    std::vector<std::int32_t> quads_, pairs_, quad_squares_;
};

std::vector<Falloff> falloffs_of(std::span<const float> locality)
{
    constexpr float most_products = 8;  // beyond, a logarithm takes no longer
    std::vector<Falloff> falloffs;
    for (const float power : locality) {
        const bool whole = power <= most_products && power == std::floor(power);
        falloffs.push_back({power, whole ? static_cast<std::int32_t>(power) : -1});
    }
    return falloffs;
}

void check_points(const Points& points, const Features& features, const char* name, const char* width_message)
{
    const std::string argument = std::string("bind: `") + name + "` ";
    const auto vertex_count = static_cast<std::int64_t>(features.vertex_count);
    for (const std::int64_t vertex : points.vertices)
        if (vertex < 0 || vertex >= vertex_count)
            throw std::invalid_argument(argument + "must lie in 0 … " + std::to_string(vertex_count - 1) + ", got " +
                                        std::to_string(vertex));
    require(points.rows.rows == 0 || points.rows.columns == features.dimension, width_message);
    require(points.offsets.empty() || points.offsets.size() == points.rows.rows,
            "bind: every handle and fixed point needs an offset, or none");
    require(std::all_of(points.offsets.begin(), points.offsets.end(), [](float offset) { return offset >= 0; }),
            "bind: offsets of handles and fixed points must be at least 0");
    require_finite(points.rows, "bind", name);
}

void require_distinct(std::span<const std::int64_t> vertices)
{
    std::vector<std::int64_t> sorted(vertices.begin(), vertices.end());
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end())
        throw std::invalid_argument("bind: `handles` names vertex " + std::to_string(*twice) + " more than once");
}

BindRange range_of(const Kernels& kernels, Features::Layout layout)
{
    switch (layout) {
    case Features::Layout::halves: return kernels.bind_halves;
    case Features::Layout::bytes: return kernels.bind_bytes;
    default: return kernels.bind_rows;
    }
}

// Past the caches go rows that follow one another, and columns that are more than can be written to at a time else:
// only whole lines go there, so those of columns must start with one.
bool can_stream(const StridedMatrix<float>& weights)
{
    if (weights.rows * weights.columns * sizeof(float) < streamed_bytes) return false;
    if (weights.row_stride != 1) return weights.row_stride == weights.columns;
    return weights.columns >= streamed_columns && weights.column_stride % 16 == 0 &&
           reinterpret_cast<std::uintptr_t>(weights.data) % 64 == 0;
}

// The kernels let pass what rounding may have added, and suspect -0.
template <class T>
void require_shares(const Matrix<const T>& geodesic)
{
    const std::span<const T> all{geodesic.data, geodesic.rows * geodesic.columns};
    const auto found = std::find_if(all.begin(), all.end(), [](T value) {
        return !(value_of(value) >= 0 && value_of(value) <= 1 + double(geodesic_slack));
    });
    if (found == all.end()) return;
    const auto index = static_cast<std::size_t>(found - all.begin());
    throw std::invalid_argument("bind: `geodesic` must lie in [0, 1], got " + std::to_string(value_of(*found)) +
                                " at [" + std::to_string(index / geodesic.columns) + ", " +
                                std::to_string(index % geodesic.columns) + "]");
}

}  // namespace

void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels)
{
    const auto& [fixed, geodesic, locality] = constraints;
    require(features.layout != Features::Layout::bytes || features.dimension <= most_byte_dimensions,
            "bind: `features` of bytes must have at most 33,000 dimensions");
    check_points(handles, features, "handles", "bind: `handles` and `features` differ in dimension");
    check_points(fixed, features, "fixed", "bind: `fixed` and `features` differ in dimension");
    require_distinct(handles.vertices);
    const std::size_t handle_count = handles.count(), fixed_count = fixed.count();
    require(weights.rows == features.vertex_count && weights.columns == handle_count,
            "bind: `weights` must be (V, H)");
    require(weights.rows * weights.columns == 0 || weights.row_stride == 1 || weights.column_stride == 1,
            "bind: `weights` must have contiguous rows or columns");
    const bool fits = std::visit(
        [&](const auto& distances) {
            return distances.rows == handle_count && distances.columns == features.vertex_count;
        },
        geodesic);
    require(locality.empty() || (locality.size() == handle_count && fits),
            "bind: `geodesic` must be (H, V) and `locality` (H)");
    for (const float exponent : locality)
        require(std::isfinite(exponent) && exponent >= 0, "bind: `locality` must be finite and at least 0");

    const PackedPoints packed(fixed, handles, features);
    const std::vector<Falloff> falloffs = falloffs_of(locality);
    BindJob job;
    job.features = features.data;
    job.vertex_count = features.vertex_count;
    job.dimension = features.dimension;
    job.scale = features.scale;
    job.targets = packed.targets;
    job.fixed_count = fixed_count;
    job.handle_count = handle_count;
    if (!locality.empty())
        std::visit([&](const auto& distances) { job.geodesic = distances.data; }, geodesic);
    job.geodesic_halves = std::holds_alternative<Matrix<const std::uint16_t>>(geodesic);
    job.falloffs = falloffs.data();
    job.weights = weights.data;
    job.row_stride = weights.row_stride;
    job.column_stride = weights.column_stride;
    job.stream = can_stream(weights);

    const Scratch scratch(threads, bind_scratch(features.dimension, handle_count));
    const BindRange bind_range = range_of(kernels, features.layout);
    std::atomic<unsigned> faults = no_fault;
    const std::size_t compared = features.dimension * (handle_count + fixed_count + 1) + 1;
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
    if ((faults & geodesic_suspect) != 0)
        std::visit([](const auto& distances) { require_shares(distances); }, geodesic);
}

}  // namespace dfd
