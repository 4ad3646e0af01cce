// Drops edits whose register a later edit writes again (CF1).
#include "usdlive/common/layer/Conflation.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <utility>

namespace usdlive {

namespace {

/// The parts of a field that later edits write, whatever it held before.
struct Written {
    bool whole = false;
    std::set<std::vector<std::string>> keys;
    std::set<double> times;
};

// Keyed by path and field.
using WrittenFields = std::map<std::pair<std::string, std::string>, Written>;

bool isCovered(const Written& written, const FieldPart& part) {
    if (written.whole) return true;
    if (const auto* key = std::get_if<DictionaryKey>(&part))
        return written.keys.contains(key->path);
    const auto* sample = std::get_if<SampleTime>(&part);
    return sample && written.times.contains(sample->time);
}

/// Marks a part as overwritten. Items of lists and maps cover nothing, because their place depends
/// on the earlier content. Erasing a part covers nothing either, because it does not change a field
/// of another form.
void cover(Written& written, const FieldPart& part, bool sets) {
    if (std::holds_alternative<std::monostate>(part)) written.whole = true;
    if (!sets) return;
    if (const auto* key = std::get_if<DictionaryKey>(&part)) written.keys.insert(key->path);
    if (const auto* sample = std::get_if<SampleTime>(&part)) written.times.insert(sample->time);
}

}  // namespace

std::vector<Edit> conflated(std::vector<Edit> edits) {
    std::map<LayerId, WrittenFields> later;
    std::vector<Edit> kept;
    kept.reserve(edits.size());
    for (auto edit = edits.rbegin(); edit != edits.rend(); ++edit) {
        const auto* set = std::get_if<SetField>(&edit->action);
        const auto* erase = std::get_if<EraseField>(&edit->action);
        if (!set && !erase) {
            later[edit->layer].clear();
        } else {
            Written& written =
                later[edit->layer][{edit->address.path, set ? set->field : erase->field}];
            const FieldPart& part = set ? set->part : erase->part;
            if (isCovered(written, part)) continue;
            cover(written, part, set != nullptr);
        }
        kept.push_back(std::move(*edit));
    }
    std::ranges::reverse(kept);
    return kept;
}

}  // namespace usdlive
