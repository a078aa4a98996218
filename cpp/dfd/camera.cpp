#include "dfd/camera.hpp"

#include "dfd/common/require.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace dfd {
namespace {

constexpr std::size_t square = 8;  // pixels along its side
constexpr double room = 1.5;       // pixels around a triangle: more than a robust ray strays
constexpr double nearest = 1e-6;   // to the eye, of what is in front of it

struct Place {
    double row, column;  // in pixels; whole numbers are centers of pixels
};

void require_camera(const Camera& camera, const char* message)
{
    require(camera.frame.rows == 4 && camera.frame.columns == 3 && camera.half_width > 0 && camera.resolution > 0,
            message);
}

template <class T>
double along(const double* axis, const T& offset)
{
    return axis[0] * offset[0] + axis[1] * offset[1] + axis[2] * offset[2];
}

/// Counts of rectangles over squares, summed only when all are there: a rectangle costs four numbers, however large.
class Squares {
public:
    explicit Squares(std::size_t side) : side_(side), steps_((side + 1) * (side + 1)) {}

    void add(std::size_t top, std::size_t left, std::size_t bottom, std::size_t right)
    {
        const std::size_t width = side_ + 1;
        ++steps_[top * width + left];
        --steps_[top * width + right + 1];
        --steps_[(bottom + 1) * width + left];
        ++steps_[(bottom + 1) * width + right + 1];
    }

    /// 1 where a rectangle is, row by row.
    std::vector<std::uint8_t> covered() const
    {
        std::vector<std::uint8_t> result(side_ * side_);
        std::vector<std::int64_t> above(side_ + 1);
        for (std::size_t row = 0; row < side_; ++row) {
            std::int64_t sum = 0;
            for (std::size_t column = 0; column < side_; ++column) {
                above[column] += steps_[row * (side_ + 1) + column];
                sum += above[column];
                result[row * side_ + column] = sum > 0;
            }
        }
        return result;
    }

private:
    std::size_t side_;
    std::vector<std::int64_t> steps_;
};

/// Where vertices appear; empty if one of a triangle is not in front of the eye, or nowhere.
std::vector<Place> project(const Camera& camera, Matrix<const float> vertices, Matrix<const std::int32_t> faces)
{
    const double *eye = camera.frame.data, *right = eye + 3, *up = eye + 6, *back = eye + 9;
    const double size = static_cast<double>(camera.resolution) / 2;
    std::vector<Place> places(vertices.rows);
    std::vector<std::uint8_t> in_front(vertices.rows);
    for (std::size_t v = 0; v < vertices.rows; ++v) {
        const float* at = vertices.data + 3 * v;
        const double offset[] = {static_cast<double>(at[0]) - eye[0], static_cast<double>(at[1]) - eye[1],
                                 static_cast<double>(at[2]) - eye[2]};
        const double depth = -along(back, offset);
        in_front[v] = depth > nearest;  // and a number
        const double width = depth * camera.half_width;
        places[v] = {(1 - along(up, offset) / width) * size - 0.5, (1 + along(right, offset) / width) * size - 0.5};
    }
    for (std::size_t i = 0; i < 3 * faces.rows; ++i)
        if (!in_front[static_cast<std::size_t>(faces.data[i])]) return {};
    return places;
}

}  // namespace

void ray_directions(const Camera& camera, std::span<const std::int64_t> pixels, Matrix<float> out)
{
    require_camera(camera, "ray_directions: `frame` must have shape (4, 3), `half_width` and `resolution` be above 0");
    require(out.rows == pixels.size() && out.columns == 3, "ray_directions: `out` must have shape (N, 3)");
    const double *right = camera.frame.data + 3, *up = right + 3, *back = right + 6;
    const std::size_t side = camera.resolution;
    std::vector<double> across(side);
    for (std::size_t i = 0; i < side; ++i)
        across[i] = ((static_cast<double>(i) + 0.5) / static_cast<double>(side) * 2 - 1) * camera.half_width;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
        const auto pixel = static_cast<std::size_t>(pixels[i]);
        require(pixels[i] >= 0 && pixel < side * side, "ray_directions: `pixels` must be those of the picture");
        const double x = across[pixel % side], y = -across[pixel / side];
        const double shorter = 1 / std::sqrt(1 + x * x + y * y);  // the axes are orthonormal
        for (std::size_t k = 0; k < 3; ++k)
            out.data[3 * i + k] = static_cast<float>((x * right[k] + y * up[k] - back[k]) * shorter);
    }
}

void may_show(const Camera& camera, Matrix<const float> vertices, Matrix<const std::int32_t> faces,
              Matrix<std::uint8_t> out)
{
    require_camera(camera, "may_show: `frame` must have shape (4, 3), `half_width` and `resolution` be above 0");
    require(vertices.columns == 3, "may_show: `vertices` must have shape (V, 3)");
    require_indices(faces, 3, vertices.rows, "may_show: `faces` must be (F, 3) vertex indices");
    require(out.rows == camera.resolution && out.columns == camera.resolution,
            "may_show: `out` must have a row and a column for each of the picture's");
    const std::size_t side = (camera.resolution + square - 1) / square;
    const std::vector<Place> places = project(camera, vertices, faces);
    if (places.empty()) {
        std::fill(out.data, out.data + out.rows * out.columns, std::uint8_t{1});
        return;
    }
    Squares squares(side);
    const double last = static_cast<double>(camera.resolution - 1);
    const auto in_squares = [](double pixel) { return static_cast<std::size_t>(pixel) / square; };
    for (std::size_t f = 0; f < faces.rows; ++f) {
        const std::int32_t* corners = faces.data + 3 * f;
        Place least = places[static_cast<std::size_t>(corners[0])], most = least;
        for (std::size_t k = 1; k < 3; ++k) {
            const Place& place = places[static_cast<std::size_t>(corners[k])];
            least = {std::min(least.row, place.row), std::min(least.column, place.column)};
            most = {std::max(most.row, place.row), std::max(most.column, place.column)};
        }
        const double top = least.row - room, left = least.column - room;
        const double bottom = most.row + room, right = most.column + room;
        if (bottom < 0 || right < 0 || top > last || left > last) continue;
        squares.add(in_squares(std::max(top, 0.0)), in_squares(std::max(left, 0.0)),
                    in_squares(std::min(bottom, last)), in_squares(std::min(right, last)));
    }
    const std::vector<std::uint8_t> covered = squares.covered();
    for (std::size_t row = 0; row < out.rows; ++row)
        for (std::size_t column = 0; column < out.columns; ++column)
            out.data[row * out.columns + column] = covered[row / square * side + column / square];
}

}  // namespace dfd
