#include "dfd/geodesics.hpp"

#include "arrays.hpp"
#include "dfd/surface/interpolation.hpp"
#include "dfd/topology.hpp"
#include "module.hpp"

#include <algorithm>

using namespace nb::literals;

namespace {

using Indices = InputMatrix<std::int32_t>;
using IndexVector = InputVector<std::int32_t>;

nb::ndarray<nb::numpy, std::int32_t, nb::ndim<1>> components(std::size_t vertex_count, const Indices& faces,
                                                              const Indices& links)
{
    std::vector<std::int32_t> found;
    {
        nb::gil_scoped_release release;
        found = dfd::components(vertex_count, matrix(faces), matrix(links));
    }
    auto* numbers = new std::vector<std::int32_t>(std::move(found));
    nb::capsule owner(numbers, [](void* p) noexcept { delete static_cast<std::vector<std::int32_t>*>(p); });
    return {numbers->data(), {numbers->size()}, owner};
}

}  // namespace

void init_geodesics(nb::module_& m)
{
    m.def("components", &components, "vertex_count"_a, "faces"_a.noconvert(), "links"_a.noconvert(),
          "Return the component index of each vertex, (V). `faces` (F, 3) and `links` (L, 2) connect the vertices.");
    m.def(
        "face_sizes",
        [](InputMatrix<double> vertices, Indices faces, OutputMatrix<double> out, int threads) {
            nb::gil_scoped_release release;
            dfd::face_sizes(matrix(vertices), matrix(faces), matrix(out), threads);
        },
        "vertices"_a.noconvert(), "faces"_a.noconvert(), "out"_a.noconvert(), "threads"_a,
        "Write the longest side and the area of each face to `out` (F, 2), for `vertices` (V, 3) and `faces` (F, 3).");
    m.def(
        "piece_sizes",
        [](InputMatrix<double> vertices, Indices faces, Indices piece, Indices flipped, OutputMatrix<double> out) {
            nb::gil_scoped_release release;
            dfd::piece_sizes(matrix(vertices), matrix(faces), matrix(piece), matrix(flipped), matrix(out));
        },
        "vertices"_a.noconvert(), "faces"_a.noconvert(), "piece"_a.noconvert(), "flipped"_a.noconvert(),
        "out"_a.noconvert(),
        "Write the area of each piece, the area of faces that are not flipped minus that of others, and the volume below "
        "the piece to `out` (P, 3). `piece` (F, 1) and `flipped` (F, 1) belong to `faces` (F, 3).");
    m.def(
        "interpolate",
        [](InputMatrix<double> vertices, InputMatrix<double> centers, IndexVector of_vertex, IndexVector starts,
           IndexVector neighbors, IndexVector chosen, InputMatrix<float> values, OutputMatrix<float> out, int threads) {
            nb::gil_scoped_release release;
            const dfd::Clusters clusters{matrix(centers), span(of_vertex), span(starts), span(neighbors)};
            dfd::interpolate(matrix(vertices), clusters, span(chosen), matrix(values), matrix(out), threads);
        },
        "vertices"_a.noconvert(), "centers"_a.noconvert(), "of_vertex"_a.noconvert(), "starts"_a.noconvert(),
        "neighbors"_a.noconvert(), "chosen"_a.noconvert(), "values"_a.noconvert(), "out"_a.noconvert(), "threads"_a,
        "Write `values` (N, K) of vertex clusters, interpolated at the vertices `chosen` (M), to `out` (M, K).");
    nb::class_<dfd::Geodesics>(m, "Geodesics", "Distances along a surface of faces and links (pairs of vertices).")
        .def(
            "__init__",
            [](dfd::Geodesics* self, InputMatrix<double> vertices, Indices faces, Indices links,
               std::size_t sample_count, int threads) {
                nb::gil_scoped_release release;
                new (self) dfd::Geodesics(matrix(vertices), matrix(faces), matrix(links), sample_count, threads);
            },
            "vertices"_a.noconvert(), "faces"_a.noconvert(), "links"_a.noconvert(), "sample_count"_a, "threads"_a)
        .def_prop_ro("extent", &dfd::Geodesics::extent, "Approximate largest distance of two connected vertices.")
        .def(
            "distances",
            [](const dfd::Geodesics& self, InputVector<std::int64_t> sources, float separate, OutputMatrix<float> out,
               int threads) {
                nb::gil_scoped_release release;
                self.distances(span(sources), separate, matrix(out), threads);
            },
            "sources"_a.noconvert(), "separate"_a, "out"_a.noconvert(), "threads"_a,
            "Write to `out` (H, V) the distances from the vertices `sources` (H) to the first V vertices, in units of "
            "`extent`. A vertex that is not connected to the source gets `separate`.");
}
