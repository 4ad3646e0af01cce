// Moves prims in all layers at once, and checks where the writes of others arrive.
#include "NamespaceEdits.h"

#include <algorithm>
#include <optional>
#include <ranges>

#include "SimClock.h"

namespace usdlive::simulation {

using client::AuthoredEdit;

namespace {

const char* const kNames[] = {"A", "B", "C", "D"};
constexpr const char* kPrimKeys = "assetInfo";
constexpr const char* kLayerKeys = "expressionVariables";
constexpr std::size_t kDeepest = 6;

std::string numbered(const char* what, std::uint64_t number) {
    return what + std::to_string(number);
}

Value specifierOver() { return {ValueType::Specifier, Bytes{1}}; }

EditAction keyEdit(const char* field, const std::string& key) {
    return SetField{field, DictionaryKey{{key}}, stringValue("x"), {}};
}

// Returns the key of an edit of that field, or nothing.
std::optional<std::string> keyOf(const EditAction& action, const char* field) {
    const auto* set = std::get_if<SetField>(&action);
    const auto* key = set && set->field == field ? std::get_if<DictionaryKey>(&set->part) : nullptr;
    if (!key || key->path.size() != 1) return std::nullopt;
    return key->path.front();
}

std::set<std::string> keysIn(const FieldValue* field) {
    std::set<std::string> keys;
    if (const auto* dictionary = field ? field->as<Dictionary>() : nullptr)
        for (const auto& [key, value] : dictionary->entries) keys.insert(key);
    return keys;
}

using PrimKeys = std::map<std::string, std::string>;  // paths by key

PrimKeys primKeys(const LayerDoc& doc, bool isUnique) {
    PrimKeys paths;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        for (const std::string& key : keysIn(doc.field(spec.path, kPrimKeys)))
            require(paths.emplace(key, spec.path).second || !isUnique,
                    "two prims have the key " + key);
    });
    return paths;
}

// The numbers of an editor are in a range of its own.
bool isOwn(const std::string& key, std::uint64_t ownNumber) {
    constexpr std::uint64_t kRange = 1'000'000;
    return std::stoull(key.substr(2)) / kRange == ownNumber / kRange;
}

}  // namespace

EditAction NamespaceEdits::identity(std::uint64_t number) {
    Dictionary keys;
    keys.entries[numbered("is", number)] = stringValue("x");
    return SetField{kPrimKeys, {}, std::move(keys), {}};
}

// Returns a random prim, or an empty path.
std::string NamespaceEdits::primOf(const LayerDoc& doc) {
    std::vector<std::string> prims;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        if (spec.kind == SpecKind::Prim) prims.emplace_back(spec.path);
    });
    return prims.empty() ? std::string() : random_.pick(prims);
}

// Returns a new path for a prim: another name, another parent, or both.
std::string NamespaceEdits::placeFor(const LayerDoc& doc, const std::string& prim) {
    std::string parent = specpath::parent(prim);
    if (random_.chance(50)) parent = random_.chance(30) ? std::string("/") : primOf(doc);
    const std::string name =
        std::string(random_.chance(50) ? specpath::last(prim).name : random_.pick(kNames));
    return specpath::child(parent, ChildList::Prims, name);
}

bool NamespaceEdits::apply(Batch& batch, const LayerId& layer, const std::string& path,
                           EditAction action) {
    if (!batch.docs.at(layer).apply(path, action, LayerDoc::By::Author)) return false;
    batch.edits.push_back({layer, path, std::move(action)});
    return true;
}

// Creates the prims above the new place that the layer lacks, as an editor does.
bool NamespaceEdits::createParents(Batch& batch, const LayerId& layer, const std::string& parent) {
    std::vector<std::string> missing;
    for (std::string path = parent; !batch.docs.at(layer).has(path); path = specpath::parent(path))
        missing.push_back(path);
    return std::ranges::all_of(std::views::reverse(missing), [&](const std::string& path) {
        return specpath::last(path).list == ChildList::Prims &&
               apply(batch, layer, path, CreateSpec{SpecKind::Prim}) &&
               apply(batch, layer, path, SetField{"specifier", {}, specifierOver(), {}}) &&
               apply(batch, layer, path, identity(++lastValue_));
    });
}

bool NamespaceEdits::correctTargets(Batch& batch, const LayerId& layer, const std::string& from,
                                    const std::string& to) {
    // Targets contain no variants.
    if (from.find('{') != std::string::npos || to.find('{') != std::string::npos) return true;
    std::vector<std::pair<std::string, EditAction>> edits;
    batch.docs.at(layer).visit([&](const LayerDoc::SpecView& spec) {
        for (const auto& [name, value] : *spec.fields) {
            const auto* list = value.as<ListOp>();
            if (!list || list->itemType != ValueType::Path) continue;
            ListOp moved = *list;
            for (auto& items : moved.lists) {
                std::vector<Value> once;
                for (Value item : items) {
                    if (const auto path = textOf(item); path && specpath::hasPrefix(*path, from))
                        item = pathValue(specpath::replacePrefix(*path, from, to));
                    if (std::ranges::find(once, item) == once.end()) once.push_back(item);
                }
                items = std::move(once);
            }
            const FieldValue corrected(std::move(moved));
            for (EditAction& part : authoredParts(name, &value, &corrected))
                edits.emplace_back(spec.path, std::move(part));
        }
    });
    if (!edits.empty()) batch.layers.insert(layer);
    return std::ranges::all_of(
        edits, [&](auto& edit) { return apply(batch, layer, edit.first, std::move(edit.second)); });
}

bool NamespaceEdits::move(Batch& batch, const std::string& from, const std::string& to) {
    if (from.empty() || from == to || specpath::hasPrefix(to, from)) return false;
    if (specpath::parse(to)->size() > kDeepest) return false;
    const std::string parent = specpath::parent(to);
    for (const auto& [layer, doc] : batch.docs)
        if (doc.has(to)) return false;  // an object is at the new place
    for (const LayerId& layer : std::views::keys(batch.docs)) {
        if (!correctTargets(batch, layer, from, to)) return false;
        if (!batch.docs.at(layer).has(from)) continue;
        batch.layers.insert(layer);
        if (!createParents(batch, layer, parent) ||
            !apply(batch, layer, from,
                   MoveSpec{{parent, {}}, std::string(specpath::last(to).name)}))
            return false;
    }
    // M15: as usdlive.NamespaceEditor does, in every layer.
    if (!namesPlaces_) return true;
    return std::ranges::all_of(std::views::keys(batch.docs), [&](const LayerId& layer) {
        return apply(batch, layer, from,
                     MoveSpec{{parent, {}}, std::string(specpath::last(to).name), true});
    });
}

std::vector<AuthoredEdit> NamespaceEdits::move(Docs& docs) {
    Batch batch{docs, {}, {}};
    namesPlaces_ = random_.chance(70);
    std::vector<LayerId> names;
    for (const LayerId& layer : std::views::keys(docs)) names.push_back(layer);
    const auto somePrim = [&] { return primOf(batch.docs.at(random_.pick(names))); };
    if (random_.chance(25)) {  // a swap
        const std::string one = somePrim(), other = somePrim(), third = "/Third";
        if (!move(batch, one, third) || !move(batch, other, one) || !move(batch, third, other))
            return {};
    } else {
        for (auto count = 1 + random_.below(3); count > 0; --count) {
            const std::string prim = somePrim();
            if (prim.empty()) return {};
            const std::string to = placeFor(batch.docs.at(random_.pick(names)), prim);
            if (!move(batch, prim, to)) return {};
        }
    }
    const std::string key = numbered("move", ++lastValue_);
    for (const LayerId& layer : batch.layers)
        if (!apply(batch, layer, "/", keyEdit(kLayerKeys, key))) return {};
    moves_[key] = {batch.layers};
    docs = std::move(batch.docs);
    return std::move(batch.edits);
}

std::vector<AuthoredEdit> NamespaceEdits::write(Docs& docs, const client::Session& session) {
    std::vector<AuthoredEdit> edits;
    for (auto& [layer, doc] : docs) {
        const std::string path = primOf(doc);
        if (path.empty()) continue;
        const auto keys = keysIn(doc.field(path, kPrimKeys));
        const auto isIdentity = [](const auto& one) { return one.starts_with("is"); };
        const auto prim = std::ranges::find_if(keys, isIdentity);
        // The server creates the parents that a place moves to (M15), and others write to them.
        const auto* specifier = doc.field(path, "specifier");
        if (prim == keys.end() && specifier && *specifier == FieldValue(specifierOver())) continue;
        require(prim != keys.end(), "a prim has lost the key that it was created with: " + path);
        // Two editors created this prim. If one of the two is moved in time, there will be two.
        if (std::ranges::count_if(keys, isIdentity) > 1) continue;
        const LayerDoc* confirmed = session.confirmed(layer);
        if (!confirmed ||
            (!isOwn(*prim, lastValue_) && !primKeys(*confirmed, false).contains(*prim)))
            continue;
        const std::string key = numbered("w", ++lastValue_);
        const EditAction action = keyEdit(kPrimKeys, key);
        if (!doc.apply(path, action)) continue;
        edits.push_back({layer, path, action});
        writes_[key] = {layer, path, *prim};
    }
    return edits;
}

void NamespaceEdits::lost(const client::LostWork& work) {
    const auto code = work.reason.code;
    End end = End::Refused;
    if (code == ErrorCode::ClientForgotten || code == ErrorCode::HistoryReplaced)
        end = End::Uncertain;
    else if (!work.refused && (code == ErrorCode::SpecDeleted || code == ErrorCode::SpecNotFound))
        // While the view is being computed, it still shows the preview of a spec that is committed.
        // The author learns at once that a write to it is not taken.
        end = work.reason.message.ends_with("only another's preview so far") ? End::Refused
                                                                             : End::Dropped;
    for (const AuthoredEdit& edit : work.edits) setEnd(edit.action, end);
}

void NamespaceEdits::committed(const Commit& commit) {
    for (const Edit& edit : commit.edits) {
        setEnd(edit.action, End::Committed);
        const auto* set = std::get_if<SetField>(&edit.action);
        if (set && set->field == kPrimKeys) madePrims_.merge(keysIn(&set->value));
    }
}

void NamespaceEdits::setEnd(const EditAction& action, End end) {
    if (const auto key = keyOf(action, kPrimKeys); key && writes_.contains(*key)) {
        Write& write = writes_.at(*key);
        write.end = end;
        write.wasBeforePrim = end == End::Dropped && isOwn(write.prim, lastValue_) &&
                              !madePrims_.contains(write.prim);
    }
    if (const auto key = keyOf(action, kLayerKeys); key && moves_.contains(*key))
        moves_.at(*key).end = end;
}

void NamespaceEdits::check(const Docs& layers, bool carriesAddresses, SimReport& report) const {
    std::map<LayerId, PrimKeys> holders;
    std::map<LayerId, std::set<std::string>> layerKeys;
    for (const auto& [layer, doc] : layers) {
        layerKeys[layer] = keysIn(doc.field("/", kLayerKeys));
        holders[layer] = primKeys(doc, carriesAddresses);
    }
    for (const auto& [key, write] : writes_) {
        const auto& keys = holders[write.layer];
        const auto holder = keys.find(key), prim = keys.find(write.prim);
        const std::string what = "the write " + key + " to " + write.path + " (" + write.prim +
                                 ") in " + write.layer.value;
        ++report.writes;
        if (holder != keys.end()) {
            require(write.end != End::Refused && write.end != End::Dropped,
                    what + " was said to be lost, but it is there (M12)");
            if (!carriesAddresses) continue;
            require(prim != keys.end() && prim->second == holder->second,
                    what + " has arrived at another prim: " + holder->second + " (M3)");
            report.carried += holder->second != write.path;
        } else if (carriesAddresses && write.end != End::Refused && write.end != End::Uncertain &&
                   !write.wasBeforePrim) {
            require(prim == keys.end(), what + " is not there, but its prim is: " +
                                            (prim == keys.end() ? "" : prim->second) + " (M3, M4)");
        }
    }
    for (const auto& [key, move] : moves_) {
        const auto present = std::ranges::count_if(
            move.layers, [&](const LayerId& layer) { return layerKeys[layer].contains(key); });
        const auto all = std::ptrdiff_t(move.layers.size());
        require(present == 0 || present == all, "a namespace edit is in a part of its layers (M6)");
        if (move.end == End::Committed || move.end == End::Pending)
            require(present == all, "a namespace edit is lost (M12): " + key);
        if (move.end == End::Refused)
            require(present == 0, "a refused namespace edit is there (M6): " + key);
        ++report.moves;
        report.movesOfSeveral += all > 1 && present == all;
        report.refusedMoves += move.end == End::Refused;
    }
}

}  // namespace usdlive::simulation
