// Checks that the decoders of frames share.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive {

// Ends the decoding of a frame. Does not leave the decoder; return values would need a check at
// every call.
struct Undecodable {
    Error error;
};

[[noreturn]] inline void stop(ErrorCode code, std::string message) {
    throw Undecodable{{code, std::move(message)}};
}
inline void require(bool condition, const char* message) {
    if (!condition) stop(ErrorCode::MalformedFrame, message);
}

/// Limits the memory of a decoded frame by its size, because a frame may refer to one text many
/// times (FR7).
class DecodingBudget {
public:
    // Estimated memory of a decoded edit without its texts; entries of a composite are small.
    static constexpr std::size_t kEditBytes = 256, kTextBytes = 32, kCompositeFactor = 6;
    // Frames of our encoder stay below the budget even if every edit repeats a long name.
    static constexpr std::size_t kCountedLayerBytes = 256;

    explicit DecodingBudget(std::size_t frameBytes) : left_(8 * frameBytes + 16 * 1024 * 1024) {}

    void spend(std::size_t bytes, std::size_t times = 1) {
        require(bytes <= left_ / times, "a frame refers to the same things too often");
        left_ -= bytes * times;
    }
    /// Counts a text, and checks that it is UTF-8.
    std::string_view text(std::string_view text) {
        spend(text.size());
        require(isUtf8(text), "a text is not UTF-8");
        return text;
    }
    /// Counts the content of a field, and decodes it.
    FieldValue content(ByteView encoded);
    /// The same for a value that is not composite.
    Value leaf(ByteView encoded);

private:
    std::size_t left_;
};

[[nodiscard]] SpecKind checkedKind(std::uint8_t kind);
/// Checks the name of a field, which is UTF-8.
[[nodiscard]] std::string checkedField(std::string_view name);
[[nodiscard]] SampleTime checkedTime(double time);
[[nodiscard]] ListName checkedList(std::uint8_t list);
/// Checks the number of parts of a dictionary key.
void checkKeyParts(std::size_t count);
/// Checks the type that an edit gives for its item or key.
void checkForm(ValueType form, const Value& item);
[[nodiscard]] Address checkedAddress(std::string path, std::uint64_t sequence, std::uint32_t edit);

}  // namespace usdlive
