// Parses the arguments of the benchmarks and prints their figures.
#include "Figures.h"

#include <algorithm>
#include <exception>
#include <iostream>
#include <sstream>
#include <stdexcept>

namespace usdlive::bench {

double percentile(std::vector<float>& values, double part) {
    if (values.empty()) return 0;
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

Arguments::Arguments(int argc, char** argv) : left_(argv + 1, argv + argc) {}

std::string Arguments::text(std::string_view name, std::string otherwise) {
    for (auto at = left_.begin(); at != left_.end(); ++at) {
        if (!at->starts_with(name)) continue;
        if (at->size() > name.size() && (*at)[name.size()] == '=') {
            std::string value = at->substr(name.size() + 1);
            left_.erase(at);
            return value;
        }
        if (at->size() == name.size() && at + 1 != left_.end()) {
            std::string value = *(at + 1);
            left_.erase(at, at + 2);
            return value;
        }
    }
    return otherwise;
}

bool Arguments::flag(std::string_view name) { return std::erase(left_, name) != 0; }

std::vector<int> Arguments::numbers(std::string_view name, std::vector<int> otherwise) {
    const std::string list = text(name, "");
    if (list.empty()) return otherwise;
    std::vector<int> numbers;
    std::istringstream items(list);
    for (std::string item; std::getline(items, item, ',');) numbers.push_back(std::stoi(item));
    return numbers;
}

int Arguments::number(std::string_view name, int otherwise) {
    return numbers(name, {otherwise}).at(0);
}

void Arguments::finish() const {
    if (!left_.empty()) throw std::invalid_argument("there is no option " + left_.front());
}

void print(std::string_view figures) { std::cout << figures << std::endl; }

int runBench(const char* name, const std::function<void()>& body) {
    try {
        body();
        return 0;
    } catch (const std::exception& fault) {
        std::cerr << "bench " << name << ": " << fault.what() << '\n';
        return 1;
    }
}

}  // namespace usdlive::bench
