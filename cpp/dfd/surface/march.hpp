#pragma once

// Fast marching: a front propagates over a surface from vertex to vertex in order of distance.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <span>
#include <utility>
#include <vector>

namespace dfd {

inline constexpr double unreached = std::numeric_limits<double>::infinity();

/// Triangles, and links: pairs of vertices that are joined by a straight line, for example across a gap.
struct Surface {
    using Triangle = std::array<std::int32_t, 3>;
    struct Link {
        std::int32_t to;
        float length;
    };

    std::vector<Triangle> triangles;
    std::vector<std::array<float, 3>> lengths;  // lengths of the sides from corner 0 to 1, 1 to 2 and 2 to 0
    std::vector<std::uint32_t> first_triangle;  // (V + 1) offsets of each vertex's range in `vertex_triangles`
    std::vector<std::int32_t> vertex_triangles; // the triangles at each vertex
    std::vector<std::uint32_t> first_link;      // (V + 1) offsets of each vertex's range in `links`
    std::vector<Link> links;                    // the links of each vertex; each link is listed at both of its ends

    std::size_t vertex_count() const { return first_triangle.empty() ? 0 : first_triangle.size() - 1; }

    std::span<const std::int32_t> triangles_of(std::int32_t vertex) const
    {
        const auto v = static_cast<std::size_t>(vertex);
        return {vertex_triangles.data() + first_triangle[v], vertex_triangles.data() + first_triangle[v + 1]};
    }

    std::span<const Link> links_of(std::int32_t vertex) const
    {
        const auto v = static_cast<std::size_t>(vertex);
        return {links.data() + first_link[v], links.data() + first_link[v + 1]};
    }
};

/// Returns the distance from a source to corner C of a triangle ABC. `a` and `b` are the distances from the source to A
/// and B; `side` is |AB|, `to_a` is |CA| and `to_b` is |CB|. The source is in the triangle's plane, beyond the line AB.
/// The result is `unreached` if the straight line from the source to C does not cross the side AB.
inline double across_triangle(double a, double b, double side, double to_a, double to_b)
{
    if (!(side > 0)) return unreached;
    const double source_x = (a * a - b * b + side * side) / (2 * side);
    const double depth = a * a - source_x * source_x;
    if (depth < 0) return unreached;
    const double corner_x = (to_a * to_a - to_b * to_b + side * side) / (2 * side);
    const double below = std::sqrt(depth), above = std::sqrt(std::max(to_a * to_a - corner_x * corner_x, 0.0));
    if (!(below + above > 0)) return unreached;
    const double crossing = source_x + (corner_x - source_x) * below / (below + above);
    if (crossing < 0 || crossing > side) return unreached;
    const double along = corner_x - source_x, height = below + above;
    return std::sqrt(along * along + height * height);
}

/// A front, and the distances of the vertices that it has reached. To `clear` a wave is faster than to make one.
class Wave {
public:
    explicit Wave(std::size_t vertex_count) : distance_(vertex_count, unreached), passed_(vertex_count, 0) {}

    double distance(std::int32_t vertex) const { return distance_[static_cast<std::size_t>(vertex)]; }
    /// Returns whether the front has passed a vertex, so that its distance is final.
    bool passed(std::int32_t vertex) const { return passed_[static_cast<std::size_t>(vertex)] != 0; }

    /// Adds a vertex to the front at `distance`, unless its present distance is at most `distance`.
    void offer(std::int32_t vertex, double distance)
    {
        const auto v = static_cast<std::size_t>(vertex);
        if (passed_[v] || !(distance < distance_[v])) return;
        if (distance_[v] == unreached) touched_.push_back(vertex);
        distance_[v] = distance;
        front_.emplace(distance, vertex);
    }

    /// Propagates the front from the offered vertices, and calls `visit(vertex, distance)` in order of distance. The
    /// front does not enter a vertex at a distance of `bound(vertex)` or more.
    template <class Bound, class Visit>
    void run(const Surface& surface, const Bound& bound, const Visit& visit)
    {
        const auto offer_below = [&](std::int32_t vertex, double distance) {
            if (distance < bound(vertex)) offer(vertex, distance);
        };
        while (!front_.empty()) {
            const auto [distance, vertex] = front_.top();
            front_.pop();
            if (passed(vertex)) continue;
            passed_[static_cast<std::size_t>(vertex)] = 1;
            visit(vertex, distance);
            for (const std::int32_t index : surface.triangles_of(vertex)) {
                const auto& corners = surface.triangles[static_cast<std::size_t>(index)];
                const auto& sides = surface.lengths[static_cast<std::size_t>(index)];
                const std::size_t here = corners[0] == vertex ? 0 : corners[1] == vertex ? 1 : 2;
                const std::size_t next = (here + 1) % 3, last = (here + 2) % 3;
                const std::int32_t x = corners[next], y = corners[last];
                const double to_x = sides[here], between = sides[next], to_y = sides[last];
                if (!passed(x)) {
                    offer_below(x, distance + to_x);
                    if (passed(y)) offer_below(x, across_triangle(distance, this->distance(y), to_y, to_x, between));
                }
                if (!passed(y)) {
                    offer_below(y, distance + to_y);
                    if (passed(x)) offer_below(y, across_triangle(distance, this->distance(x), to_x, to_y, between));
                }
            }
            for (const Surface::Link& link : surface.links_of(vertex)) offer_below(link.to, distance + link.length);
        }
    }

    void clear()
    {
        for (const std::int32_t vertex : touched_) {
            distance_[static_cast<std::size_t>(vertex)] = unreached;
            passed_[static_cast<std::size_t>(vertex)] = 0;
        }
        touched_.clear();
    }

private:
    using Entry = std::pair<double, std::int32_t>;

    std::vector<double> distance_;
    std::vector<std::uint8_t> passed_;
    std::vector<std::int32_t> touched_;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> front_;
};

}  // namespace dfd
