// Colours for terminals. Files, pipes and terminals with NO_COLOR get none.
#pragma once

#include <string>
#include <string_view>

namespace usdlive::cli {

enum class Colour { Bold = 1, Dim = 2, Red = 31, Green = 32, Yellow = 33, Cyan = 36 };

/// The colours of one output. A value; without colours, paint() returns the text unchanged.
class Palette {
public:
    Palette() = default;
    /// Returns the palette of a file descriptor: with colours if it is a terminal that supports
    /// them.
    static Palette of(int descriptor);

    [[nodiscard]] std::string paint(std::string_view text, Colour colour) const;

private:
    bool coloured_ = false;
};

}  // namespace usdlive::cli
