#include "dfd/topology.hpp"

#include "check.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

namespace {

// A cube with sides of length 1 and its corner at `x`, as (8, 3) vertices and (12, 3) outward faces.
struct Cube {
    std::vector<double> vertices;
    std::vector<std::int32_t> faces{0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                    2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};

    explicit Cube(double x)
    {
        for (int k = 0; k < 8; ++k) vertices.insert(vertices.end(), {x + (k & 1), double(k >> 1 & 1), double(k >> 2)});
    }
};

std::vector<double> sizes_of(const Cube& cube, const std::vector<std::int32_t>& piece,
                             const std::vector<std::int32_t>& flipped, std::size_t pieces)
{
    std::vector<double> out(3 * pieces, -9.0);
    dfd::piece_sizes({cube.vertices.data(), 8, 3}, {cube.faces.data(), 12, 3}, {piece.data(), piece.size(), 1},
                     {flipped.data(), flipped.size(), 1}, {out.data(), pieces, 3});
    return out;
}

}  // namespace

CASE("a cube has its volume, and minus its volume inside out")
    for (const double x : {0.0, 1e6}) {
        for (const std::int32_t flipped : {0, 1}) {
            const double sign = flipped ? -1 : 1;
            const auto sizes = sizes_of(Cube(x), std::vector(12, 0), std::vector(12, flipped), 1);
            CHECK(std::abs(sizes[0] - 6) < 1e-6);
            CHECK(std::abs(sizes[1] - 6 * sign) < 1e-6);
            CHECK(std::abs(sizes[2] - sign) < 1e-6);
        }
    }
END

CASE("an open piece has the volume between its faces and its centroid")
    std::vector<std::int32_t> piece(12, 1);
    piece[0] = piece[1] = 0;  // the bottom alone: a flat piece
    const auto sizes = sizes_of(Cube(0), piece, std::vector(12, 0), 3);
    const std::vector<double> wanted{1, 1, 0, 5, 5, 0.8, 0, 0, 0};
    for (std::size_t k = 0; k < 9; ++k) CHECK(std::abs(sizes[k] - wanted[k]) < 1e-12);
END

CASE("indices out of range and other shapes are refused")
    CHECK_THROWS(sizes_of(Cube(0), std::vector(12, 1), std::vector(12, 0), 1), "piece_sizes: `piece`");
    CHECK_THROWS(sizes_of(Cube(0), std::vector(11, 0), std::vector(12, 0), 1), "must have shape (F, 1)");
    CHECK_THROWS(sizes_of(Cube(0), std::vector(12, 0), std::vector(11, 0), 1), "must have shape (F, 1)");
END
