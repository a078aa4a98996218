#include "dfd/pose_gradients.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"
#include "unlocked.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cstring>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <vector>

using namespace nb::literals;

namespace {

using Transforms = nb::ndarray<const double, nb::shape<-1, 3, 4>, nb::c_contig, nb::device::cpu>;
using Transform = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using OutputTransforms = nb::ndarray<nb::numpy, double, nb::shape<-1, 3, 4>, nb::c_contig, nb::device::cpu>;
using OutputTransform = nb::ndarray<nb::numpy, double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using Plane = std::tuple<std::array<double, 3>, double, double>;  // unit normal, offset, half width of the blend band

template <class T>
void pose_gradients(InputMatrix<T> posed, InputMatrix<T> vertices, StridedInput<float> weights, Transforms transforms,
                    Transform rest, std::optional<Plane> plane, std::optional<InputVector<bool>> positive, int overlap,
                    std::optional<OutputMatrix<T>> out_vertices, std::optional<StridedOutput<T>> out_weights,
                    std::optional<OutputTransforms> out_transforms, std::optional<OutputTransform> out_rest,
                    int threads)
{
    std::vector<dfd::Affine> affine(transforms.shape(0));
    if (!affine.empty()) std::memcpy(affine.data(), transforms.data(), affine.size() * sizeof(dfd::Affine));
    dfd::Motion motion{affine, {}, {}, static_cast<dfd::Overlap>(overlap)};
    std::memcpy(motion.rest.data(), rest.data(), sizeof motion.rest);
    if (plane && positive) {
        const auto& [normal, offset, band] = *plane;
        motion.mirror = dfd::Mirror{normal, offset, band, {positive->data(), positive->size()}};
    }
    dfd::PoseArrays<T> arrays;
    arrays.vertices = matrix(vertices);
    arrays.weights = strided_matrix<const float>(weights, "pose: `weights` must have contiguous rows or columns");
    dfd::PoseGradients<T> gradients;
    gradients.posed = matrix(posed);
    if (out_vertices) gradients.vertices = matrix(*out_vertices);
    if (out_weights)
        gradients.weights = strided_matrix<T>(*out_weights, "pose: gradients must have contiguous rows or columns");
    if (out_transforms && out_transforms->shape(0) != affine.size())
        throw std::invalid_argument("pose: the gradient of `transforms` must be (H, 3, 4)");
    std::vector<dfd::Affine> found(out_transforms ? affine.size() : 0);
    gradients.transforms = found;
    dfd::Affine found_rest{};
    if (out_rest) gradients.rest = &found_rest;
    unlocked([&](const dfd::Poll& poll) {
        dfd::pose_gradients<T>(arrays, motion, gradients, threads, dfd::kernels(), poll);
    });
    if (!found.empty()) std::memcpy(out_transforms->data(), found.data(), found.size() * sizeof(dfd::Affine));
    if (out_rest) std::memcpy(out_rest->data(), found_rest.data(), sizeof found_rest);
}

template <class T>
void define_pose_gradients(nb::module_& m)
{
    m.def("pose_gradients", &pose_gradients<T>, "posed"_a.noconvert(), "vertices"_a.noconvert(),
          "weights"_a.noconvert(), "transforms"_a.noconvert(), "default"_a.noconvert(), "plane"_a.none(),
          "positive"_a.noconvert().none(), "overlap"_a, "out_vertices"_a.noconvert().none(),
          "out_weights"_a.noconvert().none(), "out_transforms"_a.noconvert().none(), "out_default"_a.noconvert().none(),
          "threads"_a,
          "Write the gradients of a linear `pose` to the `out` arrays that are given. `posed` (V, 3) is the gradient "
          "with respect to the posed vertices.");
}

}  // namespace

void init_pose_gradients(nb::module_& m)
{
    define_pose_gradients<float>(m);
    define_pose_gradients<double>(m);
}
