#include "dfd/transformer.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"

#include <nanobind/stl/vector.h>

#include <vector>

using namespace nb::literals;

namespace {

using Matrices = std::vector<InputMatrix<float>>;
using Vectors = std::vector<InputVector<float>>;

std::span<const float> span(const InputVector<float>& array) { return {array.data(), array.size()}; }

void make_transformer(dfd::Transformer* self, const Matrices& matrices, const Vectors& vectors, std::size_t heads,
                      float epsilon)
{
    constexpr std::size_t of_block = 4, vectors_of_block = 8;
    const std::size_t count = matrices.size() / of_block;
    if (matrices.size() != of_block * count || vectors.size() != vectors_of_block * count + 2)
        throw std::invalid_argument("Transformer: there must be 4 matrices and 8 vectors a block, and 2 vectors more");
    std::vector<dfd::BlockWeights> blocks(count);
    for (std::size_t i = 0; i < count; ++i) {
        const auto* from = &matrices[of_block * i];
        const auto* beside = &vectors[vectors_of_block * i];
        blocks[i] = {matrix(from[0]), matrix(from[1]), matrix(from[2]), matrix(from[3]), span(beside[0]), span(beside[1]),
                     span(beside[2]), span(beside[3]), span(beside[4]), span(beside[5]), span(beside[6]), span(beside[7])};
    }
    const nb::gil_scoped_release release;
    new (self) dfd::Transformer(blocks, span(vectors[vectors.size() - 2]), span(vectors.back()), heads, epsilon,
                                dfd::kernels());
}

}  // namespace

void init_transformer(nb::module_& m)
{
    nb::class_<dfd::Transformer>(m, "Transformer", "The blocks of a vision transformer, packed for the kernels.")
        .def("__init__", &make_transformer, "matrices"_a, "vectors"_a, "heads"_a, "epsilon"_a,
             nb::sig("def __init__(self, matrices: collections.abc.Sequence[numpy.typing.NDArray[numpy.float32]], "
                     "vectors: collections.abc.Sequence[numpy.typing.NDArray[numpy.float32]], heads: int, "
                     "epsilon: float) -> None"))
        .def(
            "run",
            [](const dfd::Transformer& self, InputMatrix<float> tokens, OutputMatrix<float> features) {
                const auto in = matrix(tokens);
                const auto out = matrix(features);
                nb::gil_scoped_release release;
                self.run(in, out);
            },
            "tokens"_a.noconvert(), "features"_a.noconvert(),
            nb::sig("def run(self, tokens: numpy.typing.NDArray[numpy.float32], "
                    "features: numpy.typing.NDArray[numpy.float32]) -> None"),
            "Tokens (N, D) of one picture to those after the last LayerNorm, to `features`; on one thread.");
}
