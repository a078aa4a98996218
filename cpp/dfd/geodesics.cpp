#include "dfd/geodesics.hpp"

#include "dfd/surface/march.hpp"
#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"
#include "dfd/surface/samples.hpp"

#include <algorithm>
#include <mutex>
#include <utility>

namespace dfd {

namespace {

// Distances from the source, in sample spacings. Below `near_from`, a vertex gets its distance on the mesh. Above
// `near_to`, it gets the distance interpolated from samples. In between, it gets a blend of both distances.
constexpr double near_from = 1.5, near_to = 3.0;
constexpr std::size_t grain = 4096;  // least number of vertices per thread

double smooth_step(double t)
{
    t = std::clamp(t, 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

/// A pool of `Wave` objects that threads reuse. A `Wave` is a front and the distances of the vertices that it reached.
class Waves {
public:
    explicit Waves(std::size_t vertex_count) : vertex_count_(vertex_count) {}

    template <class Use>
    void with_wave(const Use& use)
    {
        std::unique_ptr<Wave> wave;
        {
            const std::lock_guard lock(mutex_);
            if (!free_.empty()) {
                wave = std::move(free_.back());
                free_.pop_back();
            }
        }
        if (!wave) wave = std::make_unique<Wave>(vertex_count_);
        use(*wave);
        wave->clear();
        const std::lock_guard lock(mutex_);
        free_.push_back(std::move(wave));
    }

private:
    std::size_t vertex_count_;
    std::mutex mutex_;
    std::vector<std::unique_ptr<Wave>> free_;
};

}  // namespace

struct Geodesics::Impl {
    Surface mesh;
    Samples samples;         // empty if every vertex is a sample
    Surface sample_surface;  // empty if every vertex is a sample
    std::vector<SampleFit> fits;
    double extent = 0;
    std::unique_ptr<Waves> mesh_waves, sample_waves;

    bool all_samples() const { return samples.vertices.empty(); }
    const Surface& coarse() const { return all_samples() ? mesh : sample_surface; }
    Waves& coarse_waves() const { return all_samples() ? *mesh_waves : *sample_waves; }

    /// The distances from one source to all samples, and to the vertices near the source.
    struct SourceDistances {
        std::vector<float> samples;  // infinite for a sample that is not connected to the source
        std::vector<std::pair<std::int32_t, double>> near;  // each vertex near the source, and its distance
    };

    SourceDistances reach_from(std::int32_t source) const
    {
        SourceDistances found;
        found.samples.assign(coarse().vertex_count(), std::numeric_limits<float>::infinity());
        const auto run = [&](Wave& wave) {
            wave.run(coarse(), [](std::int32_t) { return unreached; },
                     [&](std::int32_t vertex, double distance) {
                         found.samples[static_cast<std::size_t>(vertex)] = static_cast<float>(distance);
                     });
        };
        if (all_samples()) {
            mesh_waves->with_wave([&](Wave& wave) {
                wave.offer(source, 0);
                run(wave);
            });
            return found;
        }
        const double limit = near_to * samples.spacing;
        mesh_waves->with_wave([&](Wave& wave) {
            wave.offer(source, 0);
            wave.run(mesh, [limit](std::int32_t) { return limit; },
                     [&](std::int32_t vertex, double distance) { found.near.emplace_back(vertex, distance); });
        });
        sample_waves->with_wave([&](Wave& wave) {
            for (const auto& [vertex, distance] : found.near) {
                const std::int32_t owner = samples.owner[static_cast<std::size_t>(vertex)];
                if (samples.vertices[static_cast<std::size_t>(owner)] == vertex) wave.offer(owner, distance);
            }
            // If edges are long, the front on the mesh may reach no sample. So the front on the samples also starts at
            // the nearest sample (the owner) of each reached vertex.
            for (const auto& [vertex, distance] : found.near) {
                const auto v = static_cast<std::size_t>(vertex);
                wave.offer(samples.owner[v], distance + samples.to_owner[v]);
            }
            run(wave);
        });
        return found;
    }

    /// Returns the distance of a vertex, interpolated from the distances of the samples around it.
    float interpolated(std::size_t vertex, const std::vector<float>& at_samples) const
    {
        const SampleFit& fit = fits[vertex];
        float sum = 0;
        for (std::size_t k = 0; k < SampleFit::count; ++k)
            sum += fit.weights[k] * at_samples[static_cast<std::size_t>(fit.samples[k])];
        return sum;
    }

    void write(const SourceDistances& found, float separate, std::span<float> out, int threads) const
    {
        const float inverse_extent = extent > 0 ? static_cast<float>(1 / extent) : 0;
        parallel_ranges(out.size(), grain, threads, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t v = begin; v < end; ++v) {
                const std::size_t sample = all_samples() ? v : static_cast<std::size_t>(samples.owner[v]);
                if (!std::isfinite(found.samples[sample])) {
                    out[v] = separate;
                } else {
                    const float distance = all_samples() ? found.samples[v] : interpolated(v, found.samples);
                    out[v] = std::clamp(distance * inverse_extent, 0.0f, 1.0f);
                }
            }
        });
        for (const auto& [vertex, distance] : found.near) {
            const auto v = static_cast<std::size_t>(vertex);
            if (v >= out.size()) continue;
            const double near = std::min(distance * inverse_extent, 1.0);
            const double far_share = smooth_step((distance / samples.spacing - near_from) / (near_to - near_from));
            out[v] = static_cast<float>(near + (out[v] - near) * far_share);
        }
    }

    /// Returns approximately the largest distance between two vertices of one connected component. Each component is
    /// measured from three vertices: any vertex, the one farthest from the first, and the one farthest from the second.
    double find_extent() const
    {
        constexpr int sweeps = 3;
        double largest = 0;
        std::vector<std::uint8_t> seen(coarse().vertex_count(), 0);
        for (std::size_t start = 0; start < seen.size(); ++start) {
            if (seen[start]) continue;
            auto source = static_cast<std::int32_t>(start);
            for (int sweep = 0; sweep < sweeps; ++sweep)
                coarse_waves().with_wave([&](Wave& wave) {
                    wave.offer(source, 0);
                    wave.run(coarse(), [](std::int32_t) { return unreached; },
                             [&](std::int32_t vertex, double distance) {
                                 seen[static_cast<std::size_t>(vertex)] = 1;
                                 source = vertex;
                                 largest = std::max(largest, distance);
                             });
                });
        }
        return largest;
    }
};

Geodesics::Geodesics(Matrix<const double> vertices, Matrix<const std::int32_t> faces,
                     Matrix<const std::int32_t> links, std::size_t sample_count, int threads)
    : impl_(std::make_unique<Impl>())
{
    require(vertices.columns == 3, "geodesics: `vertices` must have shape (V, 3)");
    require(vertices.rows < std::size_t{1} << 31, "geodesics: `vertices` must have fewer than 2^31 rows");
    require(sample_count >= 1, "geodesics: `sample_count` must be at least 1");
    require_finite(vertices, "geodesics", "vertices");
    require_indices(faces, 3, vertices.rows, "geodesics: `faces` must be (F, 3) vertex indices");
    require_indices(links, 2, vertices.rows, "geodesics: `links` must be (L, 2) vertex indices");
    impl_->mesh = surface_of(vertices, faces, links);
    impl_->mesh_waves = std::make_unique<Waves>(vertices.rows);
    if (vertices.rows > 2 * sample_count) {
        impl_->samples = take_samples(impl_->mesh, vertices, sample_count);
        std::vector<std::vector<std::int32_t>> rings;
        impl_->sample_surface = voronoi_surface(impl_->mesh, vertices, impl_->samples, rings);
        impl_->fits = linear_fits(vertices, impl_->samples, rings, threads);
        impl_->sample_waves = std::make_unique<Waves>(impl_->samples.vertices.size());
    }
    impl_->extent = impl_->find_extent();
}

Geodesics::~Geodesics() = default;

std::size_t Geodesics::vertex_count() const { return impl_->mesh.vertex_count(); }

double Geodesics::extent() const { return impl_->extent; }

void Geodesics::distances(std::span<const std::int64_t> sources, float separate, Matrix<float> out, int threads) const
{
    require(out.rows == sources.size() && out.columns <= vertex_count(),
            "geodesics: `out` must have one row per source and at most V columns");
    const auto inside = [this](std::int64_t source) {
        return source >= 0 && static_cast<std::size_t>(source) < vertex_count();
    };
    require(std::all_of(sources.begin(), sources.end(), inside), "geodesics: `sources` must be vertex indices");
    // Several sources are divided among the threads. If there is one source, the vertices are divided instead.
    const int source_threads = sources.size() > 1 ? threads : 1, row_threads = sources.size() > 1 ? 1 : threads;
    parallel_ranges(sources.size(), 1, source_threads, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t h = begin; h < end; ++h)
            impl_->write(impl_->reach_from(static_cast<std::int32_t>(sources[h])), separate, out.row(h), row_threads);
    });
}

}  // namespace dfd
