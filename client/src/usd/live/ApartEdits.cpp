// Divides edits among change blocks.
#include "usd/live/ApartEdits.h"

#include <string>
#include <utility>
#include <variant>

namespace usdlive::client {

namespace {

constexpr const char* kVariables = "expressionVariables";
constexpr const char* kSubLayers = "subLayers";

// A variable that exists only while others change.
DictionaryKey marker() { return {{"usdlive_changing"}}; }
EditAction marked(const char* value) {
    return SetField{kVariables, marker(), stringValue(value), {}};
}
EditAction unmarked() { return EraseField{kVariables, marker()}; }

const std::string* fieldOf(const EditAction& action) {
    if (const auto* set = std::get_if<SetField>(&action)) return &set->field;
    if (const auto* erase = std::get_if<EraseField>(&action)) return &erase->field;
    return nullptr;
}

}  // namespace

bool ApartEdits::take(std::string_view path, const EditAction& action) {
    const std::string* field = path == "/" ? fieldOf(action) : nullptr;
    if (!field || (*field != kVariables && *field != kSubLayers)) return false;
    (*field == kVariables ? variables_ : subLayers_).push_back(action);
    return true;
}

bool ApartEdits::isEmpty() const {
    return variables_.empty() && subLayers_.empty() && steps_.empty();
}

// Pcp (26.8) crashes if the layer that gives another one its variables changes while their values
// stay the same. So a variable that nothing uses gets another value in each step.
std::vector<EditAction> ApartEdits::next() {
    if (steps_.empty() && !variables_.empty()) {
        auto edits = std::exchange(variables_, {});
        edits.push_back(marked("b"));
        steps_ = {{marked("a")}, std::move(edits), {unmarked()}};
    } else if (steps_.empty()) {
        return std::exchange(subLayers_, {});
    }
    auto edits = std::move(steps_.front());
    steps_.pop_front();
    return edits;
}

}  // namespace usdlive::client
