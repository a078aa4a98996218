#include "dfd/surface/samples.hpp"

#include "dfd/common/parallel.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

namespace dfd {

namespace {

constexpr double packing = 1.45;     // mean area of a sample's Voronoi cell, divided by the squared spacing (measured)
constexpr double detour = 1.3;       // length of a path along edges, divided by distance along the surface (assumed)
constexpr double same_place = 1e-5;  // links up to this length join coincident vertices; longer links cross gaps
constexpr double support = 1.8;      // radius around a vertex, in sample spacings, outside which samples hardly matter
constexpr double damping = 1e-2;     // `fit_weights` damps slopes by this number times the sum of all `importance`

using Point = std::array<double, 3>;

Point point(Matrix<const double> vertices, std::int32_t vertex)
{
    const auto row = vertices.row(static_cast<std::size_t>(vertex));
    return {row[0], row[1], row[2]};
}

double apart(const Point& a, const Point& b)
{
    return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/// Returns the indices of all entries, sorted by `vertex_of(entry)`. The entries of vertex v begin at result[first[v]].
template <class VertexOf>
std::vector<std::uint32_t> group(std::size_t vertex_count, std::size_t entry_count, const VertexOf& vertex_of,
                                 std::vector<std::uint32_t>& first)
{
    first.assign(vertex_count + 1, 0);
    for (std::size_t e = 0; e < entry_count; ++e) ++first[static_cast<std::size_t>(vertex_of(e)) + 1];
    for (std::size_t v = 0; v < vertex_count; ++v) first[v + 1] += first[v];
    std::vector<std::uint32_t> order(entry_count), next(first.begin(), first.end() - 1);
    for (std::size_t e = 0; e < entry_count; ++e)
        order[next[static_cast<std::size_t>(vertex_of(e))]++] = static_cast<std::uint32_t>(e);
    return order;
}

struct Edge {
    std::int32_t a, b;
    float length;
};

/// Sets the lists of triangles and links at each vertex.
void connect(Surface& surface, std::size_t vertex_count, const std::vector<Edge>& links)
{
    const auto corner = [&](std::size_t e) { return surface.triangles[e / 3][e % 3]; };
    const auto by_corner = group(vertex_count, 3 * surface.triangles.size(), corner, surface.first_triangle);
    surface.vertex_triangles.resize(by_corner.size());
    std::transform(by_corner.begin(), by_corner.end(), surface.vertex_triangles.begin(),
                   [](std::uint32_t e) { return static_cast<std::int32_t>(e / 3); });
    const auto end = [&](std::size_t e) { return e % 2 ? links[e / 2].b : links[e / 2].a; };
    const auto by_end = group(vertex_count, 2 * links.size(), end, surface.first_link);
    surface.links.resize(by_end.size());
    std::transform(by_end.begin(), by_end.end(), surface.links.begin(), [&](std::uint32_t e) {
        return Surface::Link{e % 2 ? links[e / 2].a : links[e / 2].b, links[e / 2].length};
    });
}

double area(const Surface& mesh)
{
    double sum = 0;
    for (const auto& [a, b, c] : mesh.lengths) {
        const double s = (static_cast<double>(a) + b + c) / 2;
        sum += std::sqrt(std::max(s * (s - a) * (s - b) * (s - c), 0.0));
    }
    return sum;
}

using Pair = std::pair<std::int32_t, std::int32_t>;

/// Two samples whose Voronoi cells touch: an edge or a link joins a vertex of one cell with a vertex of the other.
struct Touching {
    Pair pair;
    double length;  // approximate distance of the two samples along the surface
    bool surface;   // false if only links across a gap join the cells
};

/// Returns all pairs of samples whose Voronoi cells touch, sorted by pair.
std::vector<Touching> touching_cells(const Surface& mesh, Matrix<const double> vertices, const Samples& samples)
{
    std::vector<Touching> found;
    const auto meet = [&](std::int32_t v, std::int32_t w, double length, bool surface) {
        const auto a = samples.owner[static_cast<std::size_t>(v)], b = samples.owner[static_cast<std::size_t>(w)];
        if (a == b) return;
        const double way = samples.to_owner[static_cast<std::size_t>(v)] + length +
                           samples.to_owner[static_cast<std::size_t>(w)];
        found.push_back({std::minmax(a, b), way, surface});
    };
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
        for (std::size_t k = 0; k < 3; ++k)
            meet(mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3], mesh.lengths[t][k], true);
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v)
        for (const auto& link : mesh.links_of(static_cast<std::int32_t>(v)))
            meet(static_cast<std::int32_t>(v), link.to, link.length, link.length <= same_place);
    std::sort(found.begin(), found.end(), [](const Touching& x, const Touching& y) {
        return x.pair != y.pair ? x.pair < y.pair : x.length < y.length;
    });
    std::size_t kept = 0;
    for (const Touching& each : found) {
        if (kept > 0 && found[kept - 1].pair == each.pair) found[kept - 1].surface |= each.surface;
        else found[kept++] = each;
    }
    found.resize(kept);
    for (Touching& each : found) {
        const auto a = static_cast<std::size_t>(each.pair.first), b = static_cast<std::size_t>(each.pair.second);
        const double chord = apart(point(vertices, samples.vertices[a]), point(vertices, samples.vertices[b]));
        each.length = std::max(chord, each.length / detour);
    }
    return found;
}

/// Sets `weights` (n) so that the sum of weights × values at `points` (n) is a linear function's value at the origin.
/// This function is fitted to the values by least squares, with the `importance` (n) of each point.
void fit_weights(std::span<const Point> points, std::span<const double> importance, std::span<float> weights)
{
    // In the basis (1, x, y, z), the value at the origin is coefficient 0, so the right-hand side is (1, 0, 0, 0).
    double a[4][4] = {}, solution[4] = {1, 0, 0, 0};
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double row[4] = {1, points[i][0], points[i][1], points[i][2]};
        for (int r = 0; r < 4; ++r)
            for (int c = 0; c <= r; ++c) a[r][c] += importance[i] * row[r] * row[c];
    }
    for (int r = 1; r < 4; ++r) a[r][r] += damping * a[0][0];
    for (int c = 0; c < 4; ++c) {  // Cholesky
        for (int k = 0; k < c; ++k) a[c][c] -= a[c][k] * a[c][k];
        a[c][c] = std::sqrt(std::max(a[c][c], 1e-30));
        for (int r = c + 1; r < 4; ++r) {
            for (int k = 0; k < c; ++k) a[r][c] -= a[r][k] * a[c][k];
            a[r][c] /= a[c][c];
        }
    }
    for (int r = 0; r < 4; ++r) {
        for (int k = 0; k < r; ++k) solution[r] -= a[r][k] * solution[k];
        solution[r] /= a[r][r];
    }
    for (int r = 3; r >= 0; --r) {
        for (int k = r + 1; k < 4; ++k) solution[r] -= a[k][r] * solution[k];
        solution[r] /= a[r][r];
    }
    double sum = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double value = importance[i] * (solution[0] + solution[1] * points[i][0] + solution[2] * points[i][1] +
                                              solution[3] * points[i][2]);
        weights[i] = static_cast<float>(value);
        sum += value;
    }
    for (std::size_t i = 0; i < points.size(); ++i) weights[i] = static_cast<float>(weights[i] / sum);
}

SampleFit fit_around(std::int32_t vertex, Matrix<const double> vertices, const Samples& samples,
                     const std::vector<std::vector<std::int32_t>>& rings)
{
    const std::int32_t owner = samples.owner[static_cast<std::size_t>(vertex)];
    const Point here = point(vertices, vertex);
    std::vector<std::pair<double, std::int32_t>> candidates;
    const auto consider = [&](std::int32_t sample) {
        const Point there = point(vertices, samples.vertices[static_cast<std::size_t>(sample)]);
        candidates.emplace_back(apart(here, there), sample);
    };
    consider(owner);
    for (const std::int32_t sample : rings[static_cast<std::size_t>(owner)]) consider(sample);
    std::sort(candidates.begin(), candidates.end());
    const std::size_t count = std::min(candidates.size(), SampleFit::count);
    // If samples are sparse, the fit includes at least the four nearest samples.
    const double reach = std::max(support * samples.spacing, 1.1 * candidates[std::min<std::size_t>(count - 1, 3)].first);
    std::array<Point, SampleFit::count> points;
    std::array<double, SampleFit::count> importance;
    SampleFit result;
    result.samples.fill(owner);
    result.weights.fill(0);
    for (std::size_t i = 0; i < count; ++i) {
        const auto& [distance, sample] = candidates[i];
        const Point there = point(vertices, samples.vertices[static_cast<std::size_t>(sample)]);
        const double share = std::max(1 - distance * distance / (reach * reach), 0.0);
        for (std::size_t axis = 0; axis < 3; ++axis) points[i][axis] = (there[axis] - here[axis]) / reach;
        importance[i] = share * share + 1e-9;
        result.samples[i] = sample;
    }
    fit_weights({points.data(), count}, {importance.data(), count}, result.weights);
    return result;
}

}  // namespace

Surface surface_of(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links)
{
    Surface surface;
    for (std::size_t f = 0; f < faces.rows; ++f) {
        const Surface::Triangle corners{faces.row(f)[0], faces.row(f)[1], faces.row(f)[2]};
        surface.triangles.push_back(corners);
        auto& lengths = surface.lengths.emplace_back();
        for (std::size_t k = 0; k < 3; ++k)
            lengths[k] = static_cast<float>(apart(point(vertices, corners[k]), point(vertices, corners[(k + 1) % 3])));
    }
    std::vector<Edge> edges;
    for (std::size_t l = 0; l < links.rows; ++l) {
        const std::int32_t a = links.row(l)[0], b = links.row(l)[1];
        edges.push_back({a, b, static_cast<float>(apart(point(vertices, a), point(vertices, b)))});
    }
    connect(surface, vertices.rows, edges);
    return surface;
}

Samples take_samples(const Surface& mesh, Matrix<const double> vertices, std::size_t count)
{
    Samples samples;
    samples.spacing = std::sqrt(area(mesh) / (packing * static_cast<double>(count)));
    samples.owner.assign(vertices.rows, -1);
    std::vector<double> nearest(vertices.rows, samples.spacing);
    Wave wave(vertices.rows);
    for (std::size_t v = 0; v < vertices.rows; ++v) {
        if (samples.owner[v] >= 0) continue;
        const auto sample = static_cast<std::int32_t>(samples.vertices.size());
        samples.vertices.push_back(static_cast<std::int32_t>(v));
        wave.offer(static_cast<std::int32_t>(v), 0);
        wave.run(mesh, [&](std::int32_t vertex) { return nearest[static_cast<std::size_t>(vertex)]; },
                 [&](std::int32_t vertex, double distance) {
                     samples.owner[static_cast<std::size_t>(vertex)] = sample;
                     nearest[static_cast<std::size_t>(vertex)] = distance;
                 });
        wave.clear();
    }
    samples.to_owner.assign(nearest.begin(), nearest.end());
    return samples;
}

Surface voronoi_surface(const Surface& mesh, Matrix<const double> vertices, const Samples& samples,
                        std::vector<std::vector<std::int32_t>>& rings)
{
    const std::vector<Touching> touching = touching_cells(mesh, vertices, samples);
    rings.assign(samples.vertices.size(), {});
    std::vector<Edge> links;
    for (const Touching& each : touching) {
        const auto [a, b] = each.pair;
        links.push_back({a, b, static_cast<float>(each.length)});
        if (!each.surface) continue;
        rings[static_cast<std::size_t>(a)].push_back(b);
        rings[static_cast<std::size_t>(b)].push_back(a);
    }
    Surface surface;
    for (const auto& corners : mesh.triangles) {
        Surface::Triangle owners;
        for (std::size_t k = 0; k < 3; ++k) owners[k] = samples.owner[static_cast<std::size_t>(corners[k])];
        std::sort(owners.begin(), owners.end());
        if (owners[0] != owners[1] && owners[1] != owners[2]) surface.triangles.push_back(owners);
    }
    std::sort(surface.triangles.begin(), surface.triangles.end());
    surface.triangles.erase(std::unique(surface.triangles.begin(), surface.triangles.end()), surface.triangles.end());
    const auto length = [&](std::int32_t a, std::int32_t b) {
        const Pair pair = std::minmax(a, b);
        const auto at = std::lower_bound(touching.begin(), touching.end(), pair,
                                         [](const Touching& each, const Pair& wanted) { return each.pair < wanted; });
        return static_cast<float>(at->length);
    };
    for (const auto& [a, b, c] : surface.triangles) surface.lengths.push_back({length(a, b), length(b, c), length(c, a)});
    connect(surface, samples.vertices.size(), links);
    return surface;
}

std::vector<SampleFit> linear_fits(Matrix<const double> vertices, const Samples& samples,
                                   const std::vector<std::vector<std::int32_t>>& rings, int threads)
{
    std::vector<SampleFit> fits(vertices.rows);
    parallel_ranges(vertices.rows, 1024, threads, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t v = begin; v < end; ++v)
            fits[v] = fit_around(static_cast<std::int32_t>(v), vertices, samples, rings);
    });
    return fits;
}

}  // namespace dfd
