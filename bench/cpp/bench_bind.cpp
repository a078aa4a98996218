// Times binding of compact features: bench_bind [vertices] [threads] [dimensions].

#include "dfd/bind.hpp"

#include "dfd/kernels/dispatch.hpp"
#include "measure.hpp"

#include <array>

namespace {

using Layout = dfd::Features::Layout;

bench::Buffer<std::uint8_t> made_bytes(std::size_t vertices, std::size_t dimensions)
{
    bench::Buffer<std::uint8_t> bytes(vertices * (dimensions + 4));
    for (std::size_t b = 0; b < vertices / 16; ++b) {
        std::uint8_t* block = bytes.data() + b * (dimensions + 4) * 16;
        std::array<std::int32_t, 16> squares{};
        for (std::size_t k = 0; k < dimensions * 16; ++k) {
            const auto entry = static_cast<std::int32_t>(bench::random_bits() % 61) - 30;
            block[k] = static_cast<std::uint8_t>(entry + 128);
            squares[k / 4 % 16] += entry * entry;
        }
        std::memcpy(block + dimensions * 16, squares.data(), sizeof squares);
    }
    return bytes;
}

/// What a call binds beside its handles.
struct Work {
    const char* name;
    std::size_t handles;
    bool narrowed = false;               // by three fixed points and locality
    std::uint32_t members = 1;           // of each handle
    dfd::Extent extent = {};
};

}  // namespace

int main(int argc, char** argv)
{
    const bench::Size size(argc, argv);
    const auto [vertices, dimensions] = size;
    const std::size_t byte_size = vertices * (dimensions + 4), half_size = 2 * vertices * dimensions;
    const bench::Timing read_bytes = bench::read_ceiling(byte_size), read_halves = bench::read_ceiling(half_size);
    bench::report("", "read as many bytes as int8", read_bytes, double(byte_size), nullptr);
    bench::report("", "read as many bytes as float16", read_halves, double(half_size), nullptr);

    const bench::Buffer<std::uint8_t> bytes = made_bytes(vertices, dimensions);
    bench::Buffer<std::uint16_t> halves(half_size / 2);
    for (std::size_t k = 0; k < halves.size; ++k)
        halves.data()[k] = static_cast<std::uint16_t>(0x2800 + bench::random_bits() % 0x400);
    constexpr std::size_t most_points = 100;
    bench::Buffer<float> points(most_points * dimensions), weights(vertices * most_points), geodesic(vertices * 10);
    for (std::size_t k = 0; k < points.size; ++k)
        points.data()[k] = static_cast<float>(int(bench::random_bits() % 61) - 30);
    for (std::size_t k = 0; k < geodesic.size; ++k) geodesic.data()[k] = bench::uniform();
    const std::vector<float> locality(10, 2.0f);

    const std::array<Work, 7> works{{
        {"bind 1", 1},
        {"bind 10", 10},
        {"bind 100", 100},
        {"bind 10 + 3 fixed + locality", 10, true},
        {"bind 10, reach 0.5", 10, false, 1, {0.5f, dfd::Falloff::linear}},
        {"bind 10 + 3 fixed + locality, smooth", 10, true, 1, {0.5f, dfd::Falloff::smooth}},
        {"bind 10 regions of 10", 10, false, 10},
    }};
    for (const std::string& name : dfd::instruction_sets()) {
        const dfd::Kernels& kernels = dfd::kernels(name);
        for (const Layout layout : {Layout::bytes, Layout::halves}) {
            for (const Work& work : works) {
                const bool is_bytes = layout == Layout::bytes;
                const void* data = is_bytes ? static_cast<const void*>(bytes.data()) : halves.data();
                const std::vector<std::uint32_t> members(work.handles, work.members);
                const std::vector<dfd::Extent> extents(work.handles, work.extent);
                dfd::Points handles{.rows = {points.data(), work.handles * work.members, dimensions}};
                if (work.members > 1) handles.members = members;
                dfd::Constraints constraints{.extents = extents};
                if (work.narrowed) {
                    constraints.fixed.rows = {points.data() + 20 * dimensions, 3, dimensions};
                    constraints.locality = {locality.data(), work.handles};
                    constraints.geodesic = {geodesic.data(), work.handles, vertices};
                }
                const bench::Timing timing = bench::measure([&] {
                    dfd::bind({layout, data, vertices, dimensions, 0.003f}, handles, constraints,
                              {weights.data(), vertices, work.handles}, bench::thread_count, kernels);
                });
                const std::size_t moved =
                    (is_bytes ? byte_size : half_size) + vertices * work.handles * (work.narrowed ? 8 : 4);
                bench::report(kernels.name, std::string(work.name) + (is_bytes ? ", int8" : ", float16"), timing,
                              double(moved), work.handles == 1 ? (is_bytes ? &read_bytes : &read_halves) : nullptr);
            }
        }
    }
}
