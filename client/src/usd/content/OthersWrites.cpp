// Notes the registers that commits of other clients write.
#include "usd/content/OthersWrites.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <mutex>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "session/Prediction.h"

namespace usdlive::content {

namespace {

/// The objects of all layers of the process. Clients of several threads use it.
struct Objects {
    std::mutex mutex;
    std::unordered_map<const void*, std::weak_ptr<OthersWrites>> byLayer;
};

Objects& objects() {
    static auto* const all = new Objects;
    return *all;
}

std::string keyOf(const std::string& field, const std::vector<std::string>& keys) {
    std::string key = field;
    for (const std::string& one : keys) key.append(1, '\0').append(one);
    return key;
}

std::string keyOf(const std::string& field, double time) {
    std::array<char, 32> text{};  // the shortest text of exactly this time
    const auto end = std::to_chars(text.data(), text.data() + text.size(), time + 0.0).ptr;
    return keyOf(field, {std::string(text.data(), end)});
}

// Returns nothing for an item of a list: ListMerge keeps the items of others.
std::optional<std::string> keyOf(const std::string& field, const FieldPart& part) {
    if (const auto* key = std::get_if<DictionaryKey>(&part)) return keyOf(field, key->path);
    if (const auto* sample = std::get_if<SampleTime>(&part)) return keyOf(field, sample->time);
    if (std::holds_alternative<ListItem>(part)) return std::nullopt;
    return field;
}

std::optional<std::string> keyOf(const EditAction& action) {
    if (const auto* set = std::get_if<SetField>(&action)) return keyOf(set->field, set->part);
    if (const auto* erase = std::get_if<EraseField>(&action))
        return keyOf(erase->field, erase->part);
    if (std::holds_alternative<PlaceSpec>(action)) return std::nullopt;
    return "";
}

}  // namespace

std::shared_ptr<OthersWrites> OthersWrites::of(const pxr::SdfLayerHandle& layer) {
    Objects& all = objects();
    const std::lock_guard guard(all.mutex);
    const void* const id = layer.GetUniqueIdentifier();
    auto found = all.byLayer[id].lock();
    if (found) return found;
    std::shared_ptr<OthersWrites> made(new OthersWrites, [id](OthersWrites* writes) {
        Objects& kept = objects();
        const std::lock_guard locked(kept.mutex);
        if (const auto entry = kept.byLayer.find(id);
            entry != kept.byLayer.end() && entry->second.expired())
            kept.byLayer.erase(entry);
        delete writes;
    });
    all.byLayer[id] = made;
    return made;
}

std::shared_ptr<OthersWrites> OthersWrites::find(const pxr::SdfLayerHandle& layer) {
    Objects& all = objects();
    const std::lock_guard guard(all.mutex);
    const auto found = all.byLayer.find(layer.GetUniqueIdentifier());
    return found == all.byLayer.end() ? nullptr : found->second.lock();
}

void OthersWrites::note(const Edit& edit, Revision revision) {
    last_ = revision;
    const auto key = keyOf(edit.action);
    if (!key) return;
    if (const auto* move = std::get_if<MoveSpec>(&edit.action)) {
        const auto to = destination(edit.address.path, *move);
        follow(edit.address.path, to);
        noteAt(to, "", revision);
    }
    noteAt(edit.address.path, *key, revision);
}

// Moves the notes of a spec and of everything below it.
void OthersWrites::follow(const std::string& from, const std::string& to) {
    std::vector<std::pair<std::string, Registers>> moved;
    for (auto spec = specs_.lower_bound(from);
         spec != specs_.end() && spec->first.starts_with(from);) {
        const auto rest = std::string_view(spec->first).substr(from.size());
        if (!rest.empty() && rest[0] != '/' && rest[0] != '.' && rest[0] != '{') {
            ++spec;
            continue;
        }
        moved.emplace_back(to + std::string(rest), std::move(spec->second));
        spec = specs_.erase(spec);
    }
    for (auto& [path, registers] : moved) specs_.insert_or_assign(path, std::move(registers));
}

void OthersWrites::noteAt(const std::string& path, std::string key, Revision revision) {
    if (count_ >= kMostRegisters) {
        specs_.clear();
        count_ = 0;
        all_ = last_;
    }
    if (specs_[path].insert_or_assign(std::move(key), revision).second) ++count_;
}

void OthersWrites::noteOwn(const Edit& edit, Revision base) {
    if (const auto* move = std::get_if<MoveSpec>(&edit.action))
        return follow(edit.address.path, destination(edit.address.path, *move));
    const auto key = keyOf(edit.action);
    const auto spec = specs_.find(edit.address.path);
    // Creating a spec that exists changes nothing (M2).
    if (!key || key->empty() || spec == specs_.end()) return;
    // The parts of a field follow it.
    Registers& registers = spec->second;
    for (auto noted = registers.lower_bound(*key);
         noted != registers.end() &&
         (noted->first == *key || noted->first.starts_with(*key + '\0'));) {
        if (noted->second <= base) {
            ++noted;
            continue;
        }
        noted = registers.erase(noted);
        --count_;
    }
}

bool OthersWrites::wrote(const pxr::SdfPath& path, const std::string& key,
                         Revision revision) const {
    if (all_ > revision) return true;
    const auto spec = specs_.find(path.GetString());
    if (spec == specs_.end()) return false;
    const auto noted = spec->second.find(key);
    return noted != spec->second.end() && noted->second > revision;
}

bool OthersWrites::changedSpec(const pxr::SdfPath& path, Revision revision) const {
    return wrote(path, "", revision);
}

bool OthersWrites::wroteSpec(const pxr::SdfPath& path, Revision revision) const {
    if (all_ > revision) return true;
    const auto spec = specs_.find(path.GetString());
    return spec != specs_.end() && std::ranges::any_of(spec->second, [&](const auto& noted) {
               return noted.second > revision;
           });
}

bool OthersWrites::wroteRegister(const Change& change, Revision revision) const {
    const std::string& field = change.field.GetString();
    if (changedSpec(change.path, revision) || wrote(change.path, field, revision)) return true;
    if (const auto* time = std::get_if<double>(&change.part))
        return wrote(change.path, keyOf(field, *time), revision);
    std::vector<std::string> keys;
    if (const auto* path = std::get_if<std::vector<std::string>>(&change.part))
        for (const std::string& key : *path) {
            keys.push_back(key);
            if (wrote(change.path, keyOf(field, keys), revision)) return true;
        }
    return false;
}

}  // namespace usdlive::content
