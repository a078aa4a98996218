#include "dfd/pose_gradients.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/scratch.hpp"
#include "dfd/pose_job.hpp"

#include <vector>

namespace dfd {
namespace {

// Number of vertices whose gradients are added in the precision of T. Sums of such chunks are added in double, in the
// order of the vertices, so that the result does not depend on the number of threads. A multiple of `gradient_tile`.
constexpr std::size_t chunk = 4096;
constexpr std::size_t entries = entries_of(Blend::linear, false);

template <class T>
void check_shapes(const PoseArrays<T>& arrays, const Motion& motion, const PoseGradients<T>& gradients)
{
    const std::size_t count = arrays.vertices.rows, handle_count = motion.transforms.size();
    require(motion.blend == Blend::linear && motion.mixing.empty() && arrays.base.data == nullptr &&
                arrays.normals.data == nullptr,
            "pose: only a linear blend has gradients");
    require(is_n_by_3(arrays.vertices, count) && is_n_by_3(gradients.posed, count),
            "pose: `vertices` and their gradient must be (V, 3)");
    require(gradients.vertices.data == nullptr || is_n_by_3(gradients.vertices, count),
            "pose: the gradient of `vertices` must be (V, 3)");
    require(arrays.weights.rows == count && arrays.weights.columns == handle_count && arrays.weights.contiguous(),
            "pose: `weights` must be (V, H) with contiguous rows or columns");
    const StridedMatrix<T>& weights = gradients.weights;
    require(weights.data == nullptr ||
                (weights.rows == count && weights.columns == handle_count && weights.contiguous()),
            "pose: the gradient of `weights` must be (V, H) with contiguous rows or columns");
    require(gradients.transforms.empty() || gradients.transforms.size() == handle_count,
            "pose: the gradient of `transforms` must be (H, 3, 4)");
    require(!motion.mirror || motion.mirror->positive.size() == handle_count,
            "pose: `symmetry` must have a side for every handle");
}

/// The gradient with respect to a `Displacement`.
struct DisplacementGradient {
    Matrix3d change{};
    Point shift{};
};

/// Returns the gradient with respect to a displacement whose entries, relative to `center`, have the gradient `table`.
DisplacementGradient from_entries(const double* table, const Point& center)
{
    DisplacementGradient result;
    for (std::size_t row = 0; row < 3; ++row) {
        result.shift[row] = table[4 * row + 3];
        for (std::size_t column = 0; column < 3; ++column)
            result.change[3 * row + column] = table[4 * row + column] + table[4 * row + 3] * center[column];
    }
    return result;
}

/// Returns the gradient with respect to D, if the displacement of R D R in Eq. (8) has the gradient `given`.
DisplacementGradient reflected(const DisplacementGradient& given, const Mirror& mirror)
{
    const Matrix3d reflection = reflection_of(mirror);
    const Point across = across_of(mirror);
    DisplacementGradient result{dfd::reflected(given.change, reflection), product(reflection, given.shift)};
    for (std::size_t i = 0; i < 9; ++i) result.change[i] += result.shift[i / 3] * across[i % 3];
    return result;
}

void add(const DisplacementGradient& gradient, Affine& sum)
{
    for (std::size_t row = 0; row < 3; ++row) {
        for (std::size_t column = 0; column < 3; ++column) sum[4 * row + column] += gradient.change[3 * row + column];
        sum[4 * row + 3] += gradient.shift[row];
    }
}

}  // namespace

template <class T>
void pose_gradients(const PoseArrays<T>& arrays, const Motion& motion, const PoseGradients<T>& gradients, int threads,
                    const Kernels& kernels, const Poll& poll)
{
    check_shapes(arrays, motion, gradients);
    require_finite_transforms(motion);
    const std::size_t count = arrays.vertices.rows, handle_count = motion.transforms.size();
    for (Affine& transform : gradients.transforms) transform = {};
    if (gradients.rest != nullptr) *gradients.rest = {};
    if (count == 0) return;

    const Point center = center_of(arrays);
    const Tables<T> tables(motion, center);
    PoseGradientJob<T> job;
    job.pose = pose_job(arrays, motion, tables, center);
    job.posed = gradients.posed.data;
    job.vertices = gradients.vertices.data;
    job.weights = gradients.weights.data;
    job.row_stride = gradients.weights.row_stride;
    job.column_stride = gradients.weights.column_stride;
    job.transforms = !gradients.transforms.empty() || gradients.rest != nullptr;

    PoseGradientRange<T> range;
    if constexpr (sizeof(T) == sizeof(float)) range = kernels.pose_gradients_float;
    else range = kernels.pose_gradients_double;
    const std::size_t chunks = (count - 1) / chunk + 1;
    const std::size_t workers = std::min(chunks, static_cast<std::size_t>(std::max(threads, 1)));
    const Scratch scratch(static_cast<int>(workers), pose_gradient_scratch(handle_count, sizeof(T)));
    const std::size_t table_size = gradient_entries(handle_count);
    std::vector<double> parts(job.transforms ? chunks * table_size : 0);
    parallel_tasks(chunks, workers, [&](std::size_t worker, std::size_t task) {
        double* const table = job.transforms ? &parts[task * table_size] : nullptr;
        range(job, task * chunk, std::min((task + 1) * chunk, count), scratch.of(worker), table);
    }, poll);
    if (!job.transforms) return;

    for (std::size_t task = 1; task < chunks; ++task)
        for (std::size_t k = 0; k < table_size; ++k) parts[k] += parts[task * table_size + k];
    const auto table = [&](std::size_t side, std::size_t row) {
        return from_entries(&parts[(side * (handle_count + 1) + row) * entries], center);
    };
    for (std::size_t k = 0; k < gradients.transforms.size(); ++k) {
        const std::size_t own = motion.mirror && !motion.mirror->positive[k] ? 1 : 0;
        add(table(own, k), gradients.transforms[k]);
        if (motion.mirror) add(reflected(table(1 - own, k), *motion.mirror), gradients.transforms[k]);
    }
    if (gradients.rest == nullptr) return;
    add(table(0, handle_count), *gradients.rest);
    if (motion.mirror) add(table(1, handle_count), *gradients.rest);
}

template void pose_gradients(const PoseArrays<float>&, const Motion&, const PoseGradients<float>&, int,
                             const Kernels&, const Poll&);
template void pose_gradients(const PoseArrays<double>&, const Motion&, const PoseGradients<double>&, int,
                             const Kernels&, const Poll&);

}  // namespace dfd
