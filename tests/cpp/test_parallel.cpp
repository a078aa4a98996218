#include "dfd/common/parallel.hpp"

#include "check.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

CASE("every index is visited once for any number of threads")
    for (const std::size_t count : {0u, 1u, 63u, 64u, 65u, 1000u}) {
        for (const int threads : {-1, 0, 1, 2, 5, 100}) {
            std::vector<std::atomic<int>> visits(count);
            std::atomic<int> wrong = 0;
            dfd::parallel_ranges(count, 64, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
                wrong += begin % 16 != 0 || worker >= std::size_t(std::max(threads, 1));
                for (std::size_t i = begin; i < end; ++i) ++visits[i];
            });
            CHECK(wrong == 0);
            CHECK(std::all_of(visits.begin(), visits.end(), [](const auto& visit) { return visit == 1; }));
        }
    }
END

CASE("a poll that returns true stops the loop")
    for (const int threads : {1, 3}) {
        std::atomic<std::size_t> visited = 0;
        int asked = 0;
        bool stopped = false;
        constexpr std::size_t count = 10'000'000;
        const auto visit = [&](std::size_t worker, std::size_t begin, std::size_t end) {
            // The other threads must not finish before the polling thread has run its ranges.
            if (worker != 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
            visited += end - begin;
        };
        try {
            dfd::parallel_ranges(count, 64, threads, visit, [&] { return ++asked == 3; });
        } catch (const dfd::Stopped&) {
            stopped = true;
        }
        CHECK(stopped && asked == 3);
        CHECK(visited > 0 && visited < count);
        visited = 0;
        dfd::parallel_ranges(count, 64, threads, visit, [] { return false; });
        CHECK(visited == count);
    }
END

CASE("the workers of a loop are an OpenMP team with the requested number of threads")
    for (const int threads : {2, 3, 7}) {
#ifdef DFD_OPENMP
        CHECK(dfd::team_size(threads) == threads);
#else
        CHECK(dfd::team_size(threads) == 0);
#endif
    }
    CHECK(dfd::team_size(1) == 0);
END
