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

/// 0 for no values. Sorts part of them.
[[nodiscard]] double percentile(std::vector<float>& values, double part);

/// `--name=value` or `--name value` of a command line, in the order asked for. Throws on what
/// nobody asked for.
class Arguments {
public:
    Arguments(int argc, char** argv);
    [[nodiscard]] std::vector<int> numbers(std::string_view name, std::vector<int> otherwise);
    [[nodiscard]] int number(std::string_view name, int otherwise);
    [[nodiscard]] std::string text(std::string_view name, std::string otherwise);
    [[nodiscard]] bool flag(std::string_view name);
    /// After all that is known was asked for.
    void finish() const;

private:
    std::vector<std::string> left_;
};

/// One line of figures (JSON), on stdout.
void print(std::string_view figures);

/// A main(): runs `body` and returns the exit status. What it throws is told as by bench `name`.
[[nodiscard]] int runBench(const char* name, const std::function<void()>& body);

}  // namespace usdlive::bench
