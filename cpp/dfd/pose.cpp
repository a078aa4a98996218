#include "dfd/pose.hpp"

#include "dfd/parallel.hpp"
#include "dfd/require.hpp"
#include "dfd/scratch.hpp"

#include <atomic>
#include <cmath>
#include <vector>

namespace dfd {
namespace {

constexpr std::size_t grain_weights = std::size_t{1} << 15;  // blended: less is not worth a thread

using Point = std::array<double, 3>;

Affine product(const Affine& a, const Affine& b)
{
    Affine result{};
    for (std::size_t row = 0; row < 3; ++row) {
        for (std::size_t column = 0; column < 4; ++column)
            for (std::size_t k = 0; k < 3; ++k) result[row * 4 + column] += a[row * 4 + k] * b[k * 4 + column];
        result[row * 4 + 3] += a[row * 4 + 3];
    }
    return result;
}

/// R D R for the reflection R across the plane.
Affine reflected(const Affine& transform, const Mirror& mirror)
{
    Affine reflection;
    for (std::size_t row = 0; row < 3; ++row) {
        for (std::size_t column = 0; column < 3; ++column)
            reflection[row * 4 + column] = (row == column ? 1.0 : 0.0) - 2.0 * mirror.normal[row] * mirror.normal[column];
        reflection[row * 4 + 3] = 2.0 * mirror.offset * mirror.normal[row];
    }
    return product(product(reflection, transform), reflection);
}

/// Appends D - I about `center`: what D adds to a point p is linear (p - center) + translation.
template <class T>
void append_displacement(std::vector<T>& table, const Affine& transform, const Point& center)
{
    for (std::size_t row = 0; row < 3; ++row) {
        double shift = transform[row * 4 + 3];
        for (std::size_t column = 0; column < 3; ++column) {
            const double entry = transform[row * 4 + column] - (row == column ? 1.0 : 0.0);
            shift += entry * center[column];
            table.push_back(static_cast<T>(entry));
        }
        table.push_back(static_cast<T>(shift));
    }
}

template <class T>
bool same_shape(const Matrix<T>& matrix, std::size_t rows)
{
    return matrix.rows == rows && matrix.columns == 3;
}

template <class T>
void check_shapes(const PoseArrays<T>& arrays, const Motion& motion)
{
    const std::size_t count = arrays.vertices.rows;
    require(same_shape(arrays.vertices, count) && same_shape(arrays.posed, count),
            "pose: `vertices` and `out` must be (V, 3)");
    require(arrays.base.data == nullptr || same_shape(arrays.base, count), "pose: `base` must be (V, 3)");
    require(arrays.normals.data == nullptr ||
                (same_shape(arrays.normals, count) && same_shape(arrays.posed_normals, count)),
            "pose: `normals` must be (V, 3)");
    require(arrays.weights.rows == count && arrays.weights.columns == motion.transforms.size(),
            "pose: `weights` must be (V, H)");
    require(arrays.weights.rows * arrays.weights.columns == 0 || arrays.weights.row_stride == 1 ||
                arrays.weights.column_stride == 1,
            "pose: `weights` must have contiguous rows or columns");
    require(!motion.mirror || motion.mirror->positive.size() == motion.transforms.size(),
            "pose: `symmetry` must know every handle's side");
}

void require_finite_transforms(const Motion& motion)
{
    for (std::size_t k = 0; k < motion.transforms.size(); ++k) {
        const Affine& transform = motion.transforms[k];
        const auto found = std::find_if_not(transform.begin(), transform.end(), [](double x) { return std::isfinite(x); });
        if (found == transform.end()) continue;
        const auto entry = static_cast<std::size_t>(found - transform.begin());
        throw std::invalid_argument("pose: `transforms` must be finite, got " + std::to_string(*found) + " at [" +
                                    std::to_string(k) + ", " + std::to_string(entry / 4) + ", " +
                                    std::to_string(entry % 4) + "]");
    }
    require_finite(Matrix<const double>{motion.rest.data(), 3, 4}, "pose", "default");
}

void require_finite_weights(const StridedMatrix<const float>& weights)
{
    for (std::size_t i = 0; i < weights.rows; ++i)
        for (std::size_t j = 0; j < weights.columns; ++j)
            if (!std::isfinite(weights(i, j)))
                throw std::invalid_argument("pose: `weights` must be finite, got " + std::to_string(weights(i, j)) +
                                            " at [" + std::to_string(i) + ", " + std::to_string(j) + "]");
}

PoseRange<float> range_of(const Kernels& kernels, const PoseJob<float>&) { return kernels.pose_float; }
PoseRange<double> range_of(const Kernels& kernels, const PoseJob<double>&) { return kernels.pose_double; }

}  // namespace

template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels)
{
    check_shapes(arrays, motion);
    require_finite_transforms(motion);
    const std::size_t count = arrays.vertices.rows;
    if (count == 0) return;

    Point center;
    for (std::size_t axis = 0; axis < 3; ++axis) center[axis] = static_cast<double>(arrays.vertices.data[axis]);
    std::vector<T> rest, positive, negative;  // what D_0 and the handles do, on either side
    append_displacement(rest, motion.rest, center);
    for (std::size_t k = 0; k < motion.transforms.size(); ++k) {
        const Affine& own = motion.transforms[k];
        if (!motion.mirror) {
            append_displacement(positive, own, center);
            continue;
        }
        const Affine other = reflected(own, *motion.mirror);
        const bool is_positive = motion.mirror->positive[k];
        append_displacement(positive, is_positive ? own : other, center);
        append_displacement(negative, is_positive ? other : own, center);
    }

    PoseJob<T> job;
    job.vertices = arrays.vertices.data;
    job.vertex_count = count;
    job.weights = arrays.weights.data;
    job.row_stride = arrays.weights.row_stride;
    job.column_stride = arrays.weights.column_stride;
    job.handle_count = motion.transforms.size();
    job.positive = positive.data();
    job.negative = negative.empty() ? nullptr : negative.data();
    const bool still = std::all_of(rest.begin(), rest.end(), [](T entry) { return entry == 0; });
    job.rest = still || arrays.base.data != nullptr ? nullptr : rest.data();
    job.base = arrays.base.data;
    job.normals = arrays.normals.data;
    job.posed_normals = arrays.posed_normals.data;
    job.posed = arrays.posed.data;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        job.center[axis] = static_cast<T>(center[axis]);
        if (motion.mirror) job.normal[axis] = static_cast<T>(motion.mirror->normal[axis]);
    }
    if (motion.mirror) {
        const auto& [normal, offset, band, sides] = *motion.mirror;
        job.height = static_cast<T>(normal[0] * center[0] + normal[1] * center[1] + normal[2] * center[2] - offset);
        job.steepness = band > 0 ? static_cast<T>(0.5 / band) : T{0};
    }

    const Scratch scratch(threads, pose_scratch(job.handle_count));
    const PoseRange<T> pose_range = range_of(kernels, job);
    std::atomic<bool> finite = true;
    const std::size_t grain = (grain_weights / (job.handle_count + 1) / block_size + 1) * block_size;
    parallel_ranges(count, grain, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
        if (!pose_range(job, begin, end, scratch.of(worker))) finite = false;
    });
    if (finite) return;
    require_finite(arrays.vertices, "pose", "vertices");
    require_finite_weights(arrays.weights);
    require_finite(arrays.base, "pose", "base");
    require_finite(arrays.normals, "pose", "normals");
    throw std::invalid_argument("pose: `transforms` move a vertex beyond the largest number that its type holds");
}

template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&);
template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&);

}  // namespace dfd
