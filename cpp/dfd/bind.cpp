#include "dfd/bind.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"
#include "dfd/common/scratch.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

namespace dfd {
namespace {

// Least number of products of feature entries per thread. With fewer, starting a thread takes longer than its work.
constexpr std::size_t grain_products = std::size_t{1} << 19;
constexpr std::size_t streamed_bytes = std::size_t{1} << 22;  // smaller weight matrices are written through the caches
constexpr std::size_t streamed_columns = 64;                  // so are matrices of fewer contiguous columns
constexpr std::size_t most_byte_dimensions = 33'000;          // with more dimensions, a square can exceed 32 bits

// Returns the number that the bits of a float16 represent.
double value_of(std::uint16_t half)
{
    const int exponent = half >> 10 & 31, fraction = half & 1023;
    const double magnitude = exponent == 31  ? (fraction == 0 ? INFINITY : NAN)
                             : exponent == 0 ? std::ldexp(fraction, -24)
                                             : std::ldexp(1024 + fraction, exponent - 25);
    return (half & 0x8000) == 0 ? magnitude : -magnitude;
}

// Writes the features (D) of a vertex to `row`. Bytes are written as integers, without multiplication by the scale.
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

// The feature rows of the fixed points, then those of the handles, in the layout of `PackedRows`: groups of 16 points.
class PackedPoints {
public:
    PackedPoints(const Points& fixed, std::span<const float> strengths, const Points& handles, const Features& features)
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
            products_fit_.assign(padded, 1);
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
        for (std::size_t p = 0; p < strengths.size(); ++p)
            if (strengths[p] == 0) offsets_[p] = std::numeric_limits<float>::max();  // so far that it has no effect
        rows = {rows_.data(),   squares_.data(),      quads_.data(),   pairs_.data(),
                products_fit_.data(), quad_squares_.data(), offsets_.data(), count};
    }

    PackedPoints(const PackedPoints&) = delete;
    PackedPoints& operator=(const PackedPoints&) = delete;

    PackedRows rows;

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
        std::int32_t square = 0, sum = 0, before = 0;
        const std::size_t group = j / group_size * (dimension_ / 4);
        for (std::size_t k = 0; k < dimension_; ++k) {
            const auto entry = static_cast<std::int32_t>(std::lround(row[k]));
            require(entry >= -127 && entry <= 127, "bind: byte entries of points must lie in -127 … 127");
            square += entry * entry;
            sum += entry;
            if (k % 2 == 1 && std::abs(before) + std::abs(entry) > most_together) products_fit_[j] = 0;
            before = entry;
            const std::size_t quad = group + k / 4, lane = j % group_size;
            insert_bits(quads_[quad * group_size + lane], entry & 0xff, k % 4 * 8);
            insert_bits(pairs_[(2 * quad + k % 2) * group_size + lane], entry & 0xffff, k % 4 / 2 * 16);
        }
        quad_squares_[j] = square + 256 * sum;  // 256 * sum cancels the 128 that is added to each entry of a vertex
    }

    static void insert_bits(std::int32_t& word, std::int32_t bits, std::size_t shift)
    {
        word = static_cast<std::int32_t>(static_cast<std::uint32_t>(word) | static_cast<std::uint32_t>(bits) << shift);
    }

    // Largest |a| + |b| of neighboring entries a and b for which 255 (|a| + |b|) fits a signed 16-bit number.
    static constexpr std::int32_t most_together = 128;

    std::size_t dimension_;
    std::vector<float> rows_, squares_, offsets_;
    std::vector<std::int32_t> quads_, pairs_, quad_squares_;
    std::vector<std::uint8_t> products_fit_;
};

std::vector<Power> powers_of(std::span<const float> locality)
{
    constexpr float most_products = 8;  // for an exponent λ above this, exp(λ log x) is at least as fast as products
    std::vector<Power> powers;
    for (const float exponent : locality) {
        const bool whole = exponent <= most_products && exponent == std::floor(exponent);
        powers.push_back({exponent, whole ? static_cast<std::int32_t>(exponent) : -1});
    }
    return powers;
}

// The strengths of fixed points, and the reach, falloff and point count of each handle. The default is as in the paper.
struct PointSettings {
    std::vector<float> strengths;
    std::vector<Reach> reaches;
    std::vector<std::uint32_t> members;
    bool general = false;  // whether a value differs from the paper's

    PointSettings(const Points& handles, const Constraints& constraints)
        : strengths(constraints.strengths.begin(), constraints.strengths.end()),
          members(handles.members.begin(), handles.members.end())
    {
        constexpr float largest_inverse = 1e30f;  // the product of an infinite 1 / reach and 0 would be NaN
        const std::size_t handle_count = handles.handle_count();
        strengths.resize(constraints.fixed.count(), 1);
        members.resize(handle_count, 1);
        for (const Extent& extent : constraints.extents) {
            reaches.push_back({std::clamp(1 / extent.reach, 1 / largest_inverse, largest_inverse), extent.falloff});
            general |= extent.reach != 1 || extent.falloff != Falloff::linear;
        }
        reaches.resize(handle_count, {1, Falloff::linear});
        const auto differs = [](auto value) { return value != 1; };
        std::replace(strengths.begin(), strengths.end(), 0.0f, 1.0f);  // `PackedPoints` made strength 0 ineffective
        general |= std::any_of(strengths.begin(), strengths.end(), differs);
        general |= std::any_of(members.begin(), members.end(), differs);
    }
};

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
            "bind: offsets must be given for every point or for none");
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

void check_shapes(const Points& handles, const Constraints& constraints)
{
    const auto& [fixed, geodesic, locality, strengths, extents] = constraints;
    if (handles.members.empty()) require_distinct(handles.vertices);
    std::size_t points = 0;
    for (const std::uint32_t members : handles.members) {
        require(members > 0, "bind: a handle that is a region must have at least one point");
        points += members;
    }
    require(handles.members.empty() || points == handles.count(), "bind: `handles` must have Σ `members` points");
    require(strengths.empty() || strengths.size() == fixed.count(), "bind: `strength` must be (P)");
    for (const float strength : strengths)
        require(strength >= 0 && strength <= 1, "bind: `strength` must lie in [0, 1]");
    require(extents.empty() || extents.size() == handles.handle_count(), "bind: `reach` and `falloff` must be (H)");
    for (const Extent& extent : extents)
        require(std::isfinite(extent.reach) && extent.reach > 0, "bind: `reach` must be finite and above 0");
}

BindRange range_of(const Kernels& kernels, Features::Layout layout)
{
    switch (layout) {
    case Features::Layout::halves: return kernels.bind_halves;
    case Features::Layout::bytes: return kernels.bind_bytes;
    default: return kernels.bind_rows;
    }
}

// Returns whether writes bypass the caches. They do if the matrix is large, with contiguous rows or aligned columns.
bool can_stream(const StridedMatrix<float>& weights)
{
    if (weights.rows * weights.columns * sizeof(float) < streamed_bytes) return false;
    if (weights.row_stride != 1) return weights.row_stride == weights.columns;
    return weights.columns >= streamed_columns && weights.column_stride % 16 == 0 &&
           reinterpret_cast<std::uintptr_t>(weights.data) % 64 == 0;
}

// Throws if a distance is negative, NaN, or above 1 by more than rounding. The kernels also report -0, which is valid.
void require_unit_interval(const Matrix<const float>& geodesic)
{
    const std::span<const float> all{geodesic.data, geodesic.rows * geodesic.columns};
    const auto found =
        std::find_if(all.begin(), all.end(), [](float value) { return !(value >= 0 && value <= 1 + geodesic_slack); });
    if (found == all.end()) return;
    const auto index = static_cast<std::size_t>(found - all.begin());
    refuse("bind: `geodesic` must lie in [0, 1]", *found, {index / geodesic.columns, index % geodesic.columns});
}

}  // namespace

void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels, const Poll& poll)
{
    const auto& [fixed, geodesic, locality, strengths, extents] = constraints;
    require(features.dimension > 0 || features.vertex_count == 0, "bind: `features` must have at least one dimension");
    require(features.layout != Features::Layout::bytes || features.dimension <= most_byte_dimensions,
            "bind: `features` of bytes must have at most 33,000 dimensions");
    check_points(handles, features, "handles", "bind: `handles` and `features` differ in dimension");
    check_points(fixed, features, "fixed", "bind: `fixed` and `features` differ in dimension");
    check_shapes(handles, constraints);
    const std::size_t handle_count = handles.handle_count(), fixed_count = fixed.count();
    require(weights.rows == features.vertex_count && weights.columns == handle_count,
            "bind: `weights` must be (V, H)");
    require(weights.contiguous(), "bind: `weights` must have contiguous rows or columns");
    require(locality.empty() || (locality.size() == handle_count && geodesic.rows == handle_count &&
                                 geodesic.columns == features.vertex_count),
            "bind: `geodesic` must be (H, V) and `locality` (H)");
    for (const float exponent : locality)
        require(std::isfinite(exponent) && exponent >= 0, "bind: `locality` must be finite and at least 0");

    const PackedPoints packed(fixed, strengths, handles, features);
    const PointSettings settings(handles, constraints);
    const std::vector<Power> powers = powers_of(locality);
    BindJob job;
    job.features = features.data;
    job.vertex_count = features.vertex_count;
    job.dimension = features.dimension;
    job.scale = features.scale;
    job.points = packed.rows;
    job.fixed_count = fixed_count;
    job.handle_count = handle_count;
    job.general = settings.general;
    job.strengths = settings.strengths.data();
    job.reaches = settings.reaches.data();
    job.members = settings.members.data();
    job.geodesic = locality.empty() ? nullptr : geodesic.data;
    job.powers = powers.data();
    job.weights = weights.data;
    job.row_stride = weights.row_stride;
    job.column_stride = weights.column_stride;
    job.stream = can_stream(weights);

    const Scratch scratch(threads, bind_scratch(features.dimension, handle_count));
    const BindRange bind_range = range_of(kernels, features.layout);
    std::atomic<unsigned> faults = no_fault;
    const std::size_t products_per_vertex = features.dimension * (packed.rows.count + 1) + 1;
    const std::size_t grain = (grain_products / products_per_vertex / block_size + 1) * block_size;
    parallel_ranges(features.vertex_count, grain, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
        faults |= bind_range(job, begin, end, scratch.of(worker));
    }, poll);
    // The kernels report squared lengths that are not finite. For float32, these may be overflows of finite features.
    if ((faults & features_suspect) != 0 && features.layout == Features::Layout::rows)
        require_finite(Matrix<const float>{static_cast<const float*>(features.data), features.vertex_count,
                                           features.dimension},
                       "bind", "features");
    require((faults & features_suspect) == 0 || features.layout != Features::Layout::halves,
            "bind: `features` must be finite");
    if ((faults & geodesic_suspect) != 0) require_unit_interval(geodesic);
}

}  // namespace dfd
