#pragma once

// A small test framework. Named cases run in order, checks continue after a failure, and a failure gives exit code 1.

#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace check {

inline int failures = 0;
inline std::vector<std::pair<std::string, std::function<void()>>> cases;

struct Case {
    Case(const char* name, std::function<void()> body) { cases.emplace_back(name, std::move(body)); }
};

inline void report(bool passed, const char* file, int line, const std::string& what)
{
    if (passed) return;
    ++failures;
    std::fprintf(stderr, "%s:%d: %s\n", file, line, what.c_str());
}

inline std::string message_of(const std::function<void()>& call)
{
    try {
        call();
    } catch (const std::invalid_argument& error) {
        return error.what();
    }
    return "no std::invalid_argument";
}

}  // namespace check

#define CHECK(condition) check::report((condition), __FILE__, __LINE__, #condition)
#define CHECK_NEAR(value, wanted, tolerance)                                                           \
    check::report(std::abs(double(value) - double(wanted)) <= (tolerance), __FILE__, __LINE__,         \
                  #value " is " + std::to_string(double(value)) + ", not " + std::to_string(double(wanted)))
#define CHECK_THROWS(call, wanted)                                                                     \
    check::report(check::message_of([&] { call; }).find(wanted) != std::string::npos, __FILE__, __LINE__, \
                  check::message_of([&] { call; }) + " should say: " wanted)
#define CASE_NAME_(line) case_##line
#define CASE_NAME(line) CASE_NAME_(line)
#define CASE(name) static const check::Case CASE_NAME(__LINE__) = {name, [] {
#define END }};

int main()
{
    for (const auto& [name, body] : check::cases) {
        const int before = check::failures;
        try {
            body();
        } catch (const std::exception& error) {
            check::report(false, __FILE__, __LINE__, error.what());
        }
        if (check::failures > before) std::fprintf(stderr, "failed: %s\n", name.c_str());
    }
    return check::failures == 0 ? 0 : 1;
}
