// Command line arguments and printed figures of the benchmarks.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace usdlive::bench {

using Clock = std::chrono::steady_clock;

[[nodiscard]] inline double millisecondsSince(Clock::time_point begin) {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

/// Returns 0 if there are no values. Sorts part of them.
[[nodiscard]] double percentile(std::vector<float>& values, double part);

/// The arguments `--name=value` or `--name value` of a command line. Throws on arguments that the
/// program does not query.
class Arguments {
public:
    Arguments(int argc, char** argv);
    [[nodiscard]] std::vector<int> numbers(std::string_view name, std::vector<int> otherwise);
    [[nodiscard]] int number(std::string_view name, int otherwise);
    [[nodiscard]] std::string text(std::string_view name, std::string otherwise);
    [[nodiscard]] bool flag(std::string_view name);
    /// Call this after querying all known arguments.
    void finish() const;

private:
    std::vector<std::string> left_;
};

/// Prints one line of figures (JSON) to stdout.
void print(std::string_view figures);

/// The body of a main(): runs `body` and returns the exit status. Prints what it throws, with the
/// bench's `name`.
[[nodiscard]] int runBench(const char* name, const std::function<void()>& body);

}  // namespace usdlive::bench
