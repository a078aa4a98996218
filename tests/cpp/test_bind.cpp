#include "dfd/bind.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

namespace {

struct Problem {
    std::size_t vertices, dimension, handles;
    std::vector<float> features, rows, weights;

    Problem(std::size_t v, std::size_t d, std::size_t h, float spread = 0.5f) : vertices(v), dimension(d), handles(h)
    {
        std::mt19937 random(static_cast<unsigned>(v + 31 * d + 1009 * h));
        std::normal_distribution<float> normal(0, spread / std::sqrt(static_cast<float>(d)));
        for (std::size_t k = 0; k < v * d; ++k) features.push_back(normal(random));
        for (std::size_t k = 0; k < h * d; ++k) rows.push_back(features[k]);
        weights.assign(v * h, -1);
    }

    std::vector<float>& bind(const dfd::Constraints& constraints = {}, int threads = 2,
                             const dfd::Kernels& kernels = dfd::kernels())
    {
        dfd::bind(source(), {{rows.data(), handles, dimension}, {}}, constraints, {weights.data(), vertices, handles},
                  threads, kernels);
        return weights;
    }

    dfd::Features source() const { return {dfd::Features::Layout::rows, features.data(), vertices, dimension}; }

    double expected(std::size_t i, const float* row) const
    {
        double square = 0;
        for (std::size_t k = 0; k < dimension; ++k) {
            const double difference = double(features[i * dimension + k]) - double(row[k]);
            square += difference * difference;
        }
        return std::max(1 - std::sqrt(square), 0.0);
    }
};

// Features whose entries are integers within ±127, stored as bytes in blocks of 16 rows.
struct Bytes {
    std::vector<float> entries;
    std::size_t dimension, count;
    float scale;
    std::vector<std::uint8_t> stored;

    Bytes(std::vector<float> rows, std::size_t d, float step)
        : entries(std::move(rows)), dimension(d), count(entries.size() / d), scale(step),
          stored((count + 15) / 16 * (d + 4) * 16)
    {
        for (std::size_t i = 0; i < count; ++i) {
            std::uint8_t* block = &stored[i / 16 * (dimension + 4) * 16];
            std::int32_t square = 0;
            for (std::size_t k = 0; k < dimension; ++k) {
                const auto value = static_cast<std::int32_t>(entries[i * dimension + k]);
                block[(k / 4 * 16 + i % 16) * 4 + k % 4] = static_cast<std::uint8_t>(value + 128);
                square += value * value;
            }
            std::memcpy(&block[(dimension / 4 * 16 + i % 16) * 4], &square, 4);
        }
    }

    // Binds the first rows as handles, checks the weights, and returns them.
    std::vector<float> checked(std::size_t handles, const std::string& name) const
    {
        std::vector<float> weights(count * handles);
        const dfd::Features source{dfd::Features::Layout::bytes, stored.data(), count, dimension, scale};
        dfd::bind(source, {{entries.data(), handles, dimension}, {}}, {}, {weights.data(), count, handles}, 2,
                  dfd::kernels(name));
        for (std::size_t i = 0; i < count; ++i) {
            for (std::size_t j = 0; j < handles; ++j) {
                double square = 0;
                for (std::size_t k = 0; k < dimension; ++k)
                    square += std::pow(double(entries[i * dimension + k]) - double(entries[j * dimension + k]), 2);
                CHECK_NEAR(weights[i * handles + j], std::max(1 - double(scale) * std::sqrt(square), 0.0), 1e-6);
            }
        }
        return weights;
    }
};

}  // namespace

CASE("distance and clamp, Equations (4) and (5)")
    for (const std::size_t dimension : {1u, 3u, 16u, 33u, 384u}) {
        for (const std::size_t handles : {1u, 2u, 7u, 25u}) {
            for (const std::string& name : dfd::instruction_sets()) {
                Problem problem(101, dimension, handles);
                problem.bind({}, 2, dfd::kernels(name));
                for (std::size_t i = 0; i < problem.vertices; ++i) {
                    for (std::size_t j = 0; j < handles; ++j) {
                        const float weight = problem.weights[i * handles + j];
                        CHECK_NEAR(weight, problem.expected(i, &problem.rows[j * dimension]), 3e-6);
                        if (i == j) CHECK(weight == 1.0f);
                    }
                }
            }
        }
    }
END

CASE("weights are bitwise equal for every number of threads and every position of a row")
    Problem problem(333, 37, 9);
    for (std::size_t i = 1; i < 333; i += 2)
        std::copy_n(&problem.features[0], 37, &problem.features[i * 37]);
    const std::vector<float> once = problem.bind({}, 1);
    for (const int threads : {2, 3, 8}) CHECK(problem.bind({}, threads) == once);
    for (std::size_t i = 1; i < 333; i += 2)
        for (std::size_t j = 0; j < 9; ++j) CHECK(once[i * 9 + j] == once[j]);
END

CASE("large results, which bypass the caches, are the same at every alignment of the output")
    constexpr std::size_t count = 16393, stride = 16400, handles = 65;  // 4.06 MiB
    Problem problem(count, 4, handles);
    const std::vector<float>& wanted = problem.bind({}, 1);
    std::vector<float> memory(stride * handles + 48);
    for (const std::string& name : dfd::instruction_sets()) {
        for (const std::size_t offset : {0u, 1u, 7u, 15u}) {
            for (const bool columns : {false, true}) {
                std::fill(memory.begin(), memory.end(), -1.0f);
                float* start = memory.data() + (0 - reinterpret_cast<std::uintptr_t>(memory.data())) % 64 / 4 + offset;
                const std::size_t down = columns ? 1 : handles, beside = columns ? stride : 1;
                dfd::bind(problem.source(), {.rows = {problem.rows.data(), handles, 4}}, {},
                          {start, count, handles, down, beside}, 3, dfd::kernels(name));
                std::size_t wrong = 0;
                for (std::size_t i = 0; i < count; ++i)
                    for (std::size_t j = 0; j < handles; ++j)
                        wrong += std::abs(start[i * down + j * beside] - wanted[i * handles + j]) > 1e-5f;
                CHECK(wrong == 0);
                CHECK(std::size_t(std::count(memory.begin(), memory.end(), -1.0f)) == memory.size() - count * handles);
            }
        }
    }
END

CASE("weights of byte features are bitwise equal on every processor")
    constexpr std::size_t count = 77, dimension = 12, handles = 19;
    std::mt19937 random(3);
    std::vector<float> entries(count * dimension);
    for (float& value : entries) value = static_cast<float>(random() % 255) - 127;
    const Bytes bytes(entries, dimension, 0.002f);
    for (const std::string& name : dfd::instruction_sets()) {
        const std::vector<float> weights = bytes.checked(handles, name);
        std::uint32_t checksum = 0;  // IEEE 754 defines every bit, because square roots are rounded correctly
        for (const float weight : weights) checksum = 31 * checksum + std::bit_cast<std::uint32_t>(weight);
        CHECK_NEAR(checksum, 3884994554u, 0);
    }
END

CASE("sums of byte products that reach the limits of 16 bits are exact")
    const std::array<float, 2> pairs[] = {{127, 1}, {64, 64}, {-64, -64}, {-127, -1}, {127, 2}, {-127, -2}, {127, 127}};
    std::vector<float> entries;
    for (const auto& pair : pairs) entries.insert(entries.end(), {pair[0], pair[1], pair[0], pair[1]});
    for (const float value : {127.0f, -127.0f}) entries.insert(entries.end(), 4, value);
    const Bytes bytes(entries, 4, 0.001f);
    for (const std::string& name : dfd::instruction_sets())
        for (std::size_t handles = 1; handles <= std::size(pairs); ++handles) bytes.checked(handles, name);
END

CASE("a single handle has the same bits as among others, on every instruction set")
    constexpr std::size_t count = 101;
    std::mt19937 random(5);
    for (const std::size_t dimension : {4u, 16u, 20u, 144u, 300u}) {
        std::vector<float> rows(count * dimension);
        for (float& value : rows) value = static_cast<float>(random() % 201) - 100;
        for (std::size_t k = dimension; k < 40 * dimension; ++k) rows[k] = rows[k % dimension] + float(random() % 3) - 1;
        const float step = 0.01f / std::sqrt(static_cast<float>(dimension));
        const Bytes bytes(rows, dimension, step);
        for (float& value : rows) value *= step;
        std::vector<std::uint16_t> halves((count + 15) / 16 * 16 * dimension);
        for (std::uint16_t& half : halves) half = static_cast<std::uint16_t>((random() & 0x83ff) | 10 << 10);  // ± 2^-5
        for (const std::string& name : dfd::instruction_sets()) {
            for (const dfd::Features& source :
                 {dfd::Features{dfd::Features::Layout::rows, rows.data(), count, dimension, 1},
                  dfd::Features{dfd::Features::Layout::halves, halves.data(), count, dimension, 1},
                  dfd::Features{dfd::Features::Layout::bytes, bytes.stored.data(), count, dimension, step}}) {
                const std::array<std::int64_t, 2> vertices{7, 50};
                std::vector<float> one(count, -1), both(2 * count);
                const std::span<const std::int64_t> first{vertices.data(), 1};
                dfd::bind(source, {.vertices = first}, {}, {one.data(), count, 1, 1, 1}, 1, dfd::kernels(name));
                dfd::bind(source, {.vertices = vertices}, {}, {both.data(), count, 2, 1, count}, 1, dfd::kernels(name));
                CHECK(std::equal(one.begin(), one.end(), both.begin()));
                CHECK(one[7] == 1 && *std::min_element(one.begin(), one.end()) < 0.9f);
            }
        }
    }
END

CASE("an unknown instruction set is refused")
    CHECK_THROWS(dfd::kernels("avx1024"), "DFD_ISA must be one of the instruction sets of this machine (baseline");
END
