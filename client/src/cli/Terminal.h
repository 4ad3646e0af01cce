// Colour for people at a terminal; none in files, pipes and where NO_COLOR is set.
#pragma once

#include <string>
#include <string_view>

namespace usdlive::cli {

enum class Colour { Bold = 1, Dim = 2, Red = 31, Green = 32, Yellow = 33, Cyan = 36 };

/// A value. What paint() returns is the text alone when there is no colour.
class Palette {
public:
    Palette() = default;
    /// For what is written to this file descriptor: colour if it is a terminal that has it.
    static Palette of(int descriptor);

    [[nodiscard]] std::string paint(std::string_view text, Colour colour) const;

private:
    bool coloured_ = false;
};

}  // namespace usdlive::cli
