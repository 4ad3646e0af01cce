// Scans the brackets of a text.
#include "usdlive/common/usd/TextDepth.h"

#include <pxr/usd/ar/asset.h>
#include <pxr/usd/ar/resolver.h>

#include <algorithm>
#include <array>
#include <string_view>

namespace usdlive::usd {

namespace {

// Limits of a text. Sdf's parser takes up to 300 bytes of the stack for a bracket, and 2 KiB for a
// parenthesis of a path expression, which is inside a string.
constexpr std::size_t kMostBrackets = 4096;
constexpr std::size_t kMostParentheses = 1024;
// SdfPath counts no further. It also calls itself for each element when a path is destroyed.
constexpr std::size_t kMostElements = 65'535;

// Finds how deeply the brackets of a text nest, outside and inside of strings.
class NestingScan {
public:
    explicit NestingScan(std::string_view text) : text_(text) {}

    // Returns the line of the first bracket that is nested too deeply, or 0.
    std::size_t run() {
        std::size_t brackets = 0;
        while (at_ < text_.size()) {
            const char c = text_[at_];
            if (c == '{' || c == '(' || c == '[') {
                if (++brackets > kMostBrackets) return line();
            } else if (c == '}' || c == ')' || c == ']') {
                brackets -= brackets > 0;
            } else if (c == '"' || c == '\'') {
                if (!skipString(c)) return line();
                continue;
            } else if (c == '@') {
                skipAsset();
                continue;
            } else if (c == '#' || text_.substr(at_, 2) == "//") {
                skipTo("\n");
                continue;
            } else if (text_.substr(at_, 2) == "/*") {
                ++at_;
                skipTo("*/");
                continue;
            } else if (c == '<') {
                const std::size_t begin = at_;
                skipTo(">");
                if (countSlashes(begin) > kMostElements) return line();
                continue;
            }
            ++at_;
        }
        return 0;
    }

private:
    [[nodiscard]] std::size_t line() const {
        return 1 +
               std::size_t(std::count(text_.begin(), text_.begin() + std::ptrdiff_t(at_), '\n'));
    }

    [[nodiscard]] std::size_t countSlashes(std::size_t begin) const {
        if (at_ - begin <= kMostElements) return 0;
        return std::size_t(std::ranges::count(text_.substr(begin, at_ - begin), '/'));
    }

    void skipTo(std::string_view end) {
        const std::size_t found = text_.find(end, at_ + 1);
        at_ = found == std::string_view::npos ? text_.size() : found + end.size();
    }

    void skipAsset() {
        if (text_.substr(at_, 3) != "@@@") return skipTo("@");
        at_ += 2;
        do skipTo("@@@");
        while (at_ < text_.size() && text_[at_ - 4] == '\\');
    }

    bool skipString(char quote) {
        const std::string end(text_.substr(at_, 3) == std::string(3, quote) ? 3 : 1, quote);
        std::size_t parentheses = 0;
        for (at_ += end.size(); at_ < text_.size(); ++at_) {
            const char c = text_[at_];
            if (c == quote && text_.substr(at_, end.size()) == end) {
                at_ += end.size();
                return true;
            }
            if (c == '\\') ++at_;
            if (c == '\n' && end.size() == 1) return true;  // the parser refuses it
            if (c == '(' && ++parentheses > kMostParentheses) return false;
            if (c == ')') parentheses -= parentheses > 0;
        }
        return true;
    }

    const std::string_view text_;
    std::size_t at_ = 0;
};

}  // namespace

std::string whyTooDeep(const pxr::ArResolvedPath& file) {
    const auto asset = pxr::ArGetResolver().OpenAsset(file);
    std::array<char, 4> start{};
    if (!asset || asset->GetSize() <= kMostParentheses ||
        asset->Read(start.data(), start.size(), 0) != start.size() || start[0] != '#')
        return {};
    const auto text = asset->GetBuffer();
    if (!text) return {};
    const auto line = NestingScan({text.get(), asset->GetSize()}).run();
    if (line == 0) return {};
    return "line " + std::to_string(line) + " is nested too deeply. At most " +
           std::to_string(kMostBrackets) + " brackets may be open and " +
           std::to_string(kMostParentheses) + " parentheses in a string, and a path may have " +
           std::to_string(kMostElements) + " elements.";
}

}  // namespace usdlive::usd
