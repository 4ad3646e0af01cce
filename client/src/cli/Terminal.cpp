// Writes colours for terminals.
#include "cli/Terminal.h"

#include <unistd.h>

#include <cstdlib>

namespace usdlive::cli {

Palette Palette::of(int descriptor) {
    const char* without = std::getenv("NO_COLOR");  // https://no-color.org
    const char* terminal = std::getenv("TERM");
    Palette palette;
    palette.coloured_ = ::isatty(descriptor) == 1 && !(without && *without) && terminal &&
                        std::string_view(terminal) != "dumb";
    return palette;
}

std::string Palette::paint(std::string_view text, Colour colour) const {
    if (!coloured_ || text.empty()) return std::string(text);
    return "\x1b[" + std::to_string(int(colour)) + "m" + std::string(text) + "\x1b[0m";
}

}  // namespace usdlive::cli
