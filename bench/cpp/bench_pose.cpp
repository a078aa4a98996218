// Times posing: bench_pose [vertices] [threads].

#include "dfd/pose.hpp"

#include "dfd/kernels/dispatch.hpp"
#include "measure.hpp"

#include <array>

namespace {

struct Work {
    const char* name;
    std::size_t handles;
    dfd::Blend blend = dfd::Blend::linear;
    bool mirrored = false, based = false, stretched = true;
};

/// A turn about z by 0.3 to 1.3, and where asked a stretch after it.
dfd::Affine made_transform(bool stretched)
{
    const double angle = 0.3 + double(bench::uniform()), c = std::cos(angle), s = std::sin(angle);
    const double along = stretched ? 1.2 : 1.0;
    return {along * c, -s, 0, double(bench::uniform()), along * s, c, 0, double(bench::uniform()), 0, 0, 1, 0};
}

}  // namespace

int main(int argc, char** argv)
{
    const bench::Size size(argc, argv);
    const std::size_t vertices = size.vertices, pose_size = vertices * 28;
    const bench::Timing copy = bench::copy_ceiling(pose_size);
    bench::report("", "copy 28 bytes a vertex", copy, double(pose_size), nullptr);

    constexpr std::size_t most_handles = 100;
    bench::Buffer<float> points(3 * vertices), posed(3 * vertices), single(vertices), many(vertices * most_handles);
    for (std::size_t k = 0; k < points.size; ++k) points.data()[k] = bench::uniform();
    for (std::size_t k = 0; k < single.size; ++k) single.data()[k] = bench::uniform();
    for (std::size_t k = 0; k < many.size; ++k) many.data()[k] = bench::uniform() / most_handles;
    std::vector<dfd::Affine> rigid, stretching;
    std::vector<std::array<double, 3>> places;
    for (std::size_t k = 0; k < most_handles; ++k) {
        rigid.push_back(made_transform(false));
        stretching.push_back(made_transform(true));
        places.push_back({double(bench::uniform()), double(bench::uniform()), double(bench::uniform())});
    }
    constexpr dfd::Affine identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const std::unique_ptr<bool[]> sides(new bool[most_handles]());

    constexpr dfd::Blend dual_quaternion = dfd::Blend::dual_quaternion, polar = dfd::Blend::polar;
    const std::array<Work, 11> works{{
        {"pose 1", 1},
        {"pose 1 across a mirror", 1, dfd::Blend::linear, true},
        {"drag 1", 1, dfd::Blend::linear, false, true},
        {"pose 1, rigid dual quaternions", 1, dual_quaternion, false, false, false},
        {"pose 1, dual quaternions", 1, dual_quaternion},
        {"pose 1, polar", 1, polar},
        {"pose 1 across a mirror, polar", 1, polar, true},
        {"pose 100", most_handles},
        {"pose 100, rigid dual quaternions", most_handles, dual_quaternion, false, false, false},
        {"pose 100, dual quaternions", most_handles, dual_quaternion},
        {"pose 100, polar", most_handles, polar},
    }};
    for (const std::string& name : dfd::instruction_sets()) {
        const dfd::Kernels& kernels = dfd::kernels(name);
        for (const Work& work : works) {
            dfd::PoseArrays<float> arrays;
            arrays.vertices = {points.data(), vertices, 3};
            arrays.weights = {work.handles == 1 ? single.data() : many.data(), vertices, work.handles};
            arrays.posed = {posed.data(), vertices, 3};
            if (work.based) arrays.base = arrays.vertices;
            const std::vector<dfd::Affine>& transforms = work.stretched ? stretching : rigid;
            dfd::Motion motion{{transforms.data(), work.handles}, identity, {}};
            motion.blend = work.blend;
            motion.places = {places.data(), work.handles};
            if (work.mirrored) motion.mirror = dfd::Mirror{{1, 0, 0}, 0.5, 0.01, {sides.get(), work.handles}};
            const bench::Timing timing =
                bench::measure([&] { dfd::pose<float>(arrays, motion, bench::thread_count, kernels); });
            bench::report(kernels.name, work.name, timing, double(vertices * (24 + 4 * work.handles)),
                          work.handles == 1 ? &copy : nullptr);
        }
    }
}
