#include "dfd/pose.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/scratch.hpp"
#include "dfd/pose_job.hpp"

#include <atomic>
#include <cmath>
#include <vector>

namespace dfd {
namespace {

// Least number of weights per thread. With fewer, starting a thread takes longer than its work.
constexpr std::size_t grain_weights = std::size_t{1} << 15;

template <class T>
void check_shapes(const PoseArrays<T>& arrays, const Motion& motion)
{
    const std::size_t count = arrays.vertices.rows, handle_count = motion.transforms.size();
    require(is_n_by_3(arrays.vertices, count) && is_n_by_3(arrays.posed, count),
            "pose: `vertices` and `out` must be (V, 3)");
    require(arrays.base.data == nullptr || is_n_by_3(arrays.base, count), "pose: `base` must be (V, 3)");
    require(arrays.normals.data == nullptr ||
                (is_n_by_3(arrays.normals, count) && is_n_by_3(arrays.posed_normals, count)),
            "pose: `normals` must be (V, 3)");
    require(arrays.weights.rows == count && arrays.weights.columns == handle_count, "pose: `weights` must be (V, H)");
    require(arrays.weights.contiguous(), "pose: `weights` must have contiguous rows or columns");
    require(!motion.mirror || motion.mirror->positive.size() == handle_count,
            "pose: `symmetry` must have a side for every handle");
    require(motion.blend == Blend::linear || motion.polar.size() == handle_count * (motion.mirror ? 2 : 1) + 1,
            "pose: `polar` must have a row for each handle, for each mirrored handle, and for the default");
    require(motion.blend == Blend::linear || arrays.base.data == nullptr, "pose: only a linear blend takes a `base`");
    require(motion.mixing.empty() || motion.mixing.size() == handle_count * handle_count,
            "pose: `mixing` must be (H, H)");
}

void require_finite_weights(const StridedMatrix<const float>& weights)
{
    for (std::size_t i = 0; i < weights.rows; ++i)
        for (std::size_t j = 0; j < weights.columns; ++j)
            if (!std::isfinite(weights(i, j))) refuse("pose: `weights` must be finite", weights(i, j), {i, j});
}

}  // namespace

template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels,
          const Poll& poll)
{
    check_shapes(arrays, motion);
    require_finite_transforms(motion);
    const std::size_t count = arrays.vertices.rows;
    if (count == 0) return;

    const Point center = center_of(arrays);
    const Tables<T> tables(motion, center);
    const PoseJob<T> job = pose_job(arrays, motion, tables, center);

    const Scratch scratch(threads, pose_scratch(job.handle_count));
    PoseRange<T> pose_range;
    if constexpr (sizeof(T) == sizeof(float)) pose_range = kernels.pose_float;
    else pose_range = kernels.pose_double;
    std::atomic<bool> finite = true;
    const std::size_t grain = (grain_weights / (job.handle_count + 1) / block_size + 1) * block_size;
    parallel_ranges(count, grain, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
        if (!pose_range(job, begin, end, scratch.of(worker))) finite = false;
    }, poll);
    if (finite) return;
    require_finite(arrays.vertices, "pose", "vertices");
    require_finite_weights(arrays.weights);
    require_finite(arrays.base, "pose", "base");
    require_finite(arrays.normals, "pose", "normals");
    throw std::invalid_argument("pose: `transforms` move a vertex beyond the largest number that its type holds");
}

template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&, const Poll&);
template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&, const Poll&);

}  // namespace dfd
