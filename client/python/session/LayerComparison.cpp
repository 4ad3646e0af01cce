// Finds what an editor has changed in a layer, by a comparison with what it was shown.
#include "LayerComparison.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "basics/Placements.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/FileRules.h"

namespace usdlive::client {

namespace {

constexpr std::string_view kTypeNameField = "typeName";
// Python's Sdf cannot order the variants and variant sets that a layer has.
constexpr ChildList kOrderedLists[] = {ChildList::Prims, ChildList::Properties};

// Sdf lists the fields that a spec must have, also if it only has their fallbacks.
bool isFallback(SpecKind kind, std::string_view field, const FieldValue& value) {
    const auto* leaf = value.as<Value>();
    if (!leaf || leaf->isBlob() || leaf->bytes().size() != 1) return false;
    const auto number = leaf->bytes()[0];
    if (field == "custom") return number == 0;
    if (field == "variability") return number == 0 || kind == SpecKind::Relationship;
    return field == "specifier" && number == 1;  // over
}

// Calls `change` for each leaf of the value that can be a blob. Stops at its first error.
template <class Change>
Result<void> changeLeaves(Dictionary& dictionary, const Change& change) {
    for (auto& [key, entry] : dictionary.entries) {
        auto* nested = std::get_if<Dictionary>(&entry);
        auto done = nested ? changeLeaves(*nested, change) : change(std::get<Value>(entry));
        if (!done) return done;
    }
    return {};
}

template <class Change>
Result<void> changeLeaves(FieldValue& value, const Change& change) {
    if (auto* leaf = value.as<Value>()) return change(*leaf);
    if (auto* dictionary = value.as<Dictionary>()) return changeLeaves(*dictionary, change);
    if (auto* samples = value.as<TimeSamples>())
        for (auto& [time, sample] : samples->samples)
            if (auto done = change(sample); !done) return done;
    return {};
}

Result<FieldValue> withBlobs(ByteView bytes, BlobSink& blobs) {
    auto value = decodeFieldValue(bytes);
    if (!value) return value;
    auto done = changeLeaves(*value, [&blobs](Value& leaf) -> Result<void> {
        if (leaf.isBlob() || leaf.size() < kBigValueBytes || !canBeBlob(leaf.type())) return {};
        if (holdsNul(leaf.type(), leaf.bytes()))
            return fail(ErrorCode::InvalidValue, "a text holds a NUL, which no file can have");
        const Hash hash = sha256(leaf.bytes());
        blobs.keepBlob(hash,
                       std::make_shared<const Bytes>(leaf.bytes().begin(), leaf.bytes().end()));
        leaf = Value::blob(leaf.type(), hash, leaf.size());
        return {};
    });
    if (!done) return tl::unexpected(done.error());
    return value;
}

class Comparison {
public:
    using Keeps = std::function<bool(std::string_view, std::string_view, const Bytes&)>;

    Comparison(const LayerId& layer, const LayerDoc& shown, const std::vector<SeenSpec>& seen,
               const Keeps& keeps, BlobSink& blobs, BlobSource& source)
        : layer_(layer), shown_(shown), seen_(seen), keeps_(keeps), blobs_(blobs), source_(source) {
        changes_.after = shown;
        for (std::size_t i = 0; i < seen.size(); ++i) indexes_.emplace(seen[i].path, i);
    }

    LayerChanges compare() {
        compareSpecs();
        for (const SeenSpec& spec : seen_)
            if (doc().kind(spec.path) == spec.kind) compareFields(spec);
        compareOrders();
        return std::move(changes_);
    }

private:
    [[nodiscard]] LayerDoc& doc() { return changes_.after; }
    [[nodiscard]] const SeenSpec* seenAt(std::string_view path) const {
        const auto found = indexes_.find(path);
        return found == indexes_.end() ? nullptr : &seen_[found->second];
    }

    // Refuses content that no file can have (ED8-ED12), and what the model refuses.
    Result<void> record(const std::string& path, EditAction action) {
        if (auto proper = checkForFile(doc(), path, action); !proper) return proper;
        const auto applied = doc().apply(path, action, LayerDoc::By::Author);
        if (!applied) return tl::unexpected(applied.error());
        if (applied->changed) changes_.edits.push_back({layer_, path, std::move(action)});
        return {};
    }
    void refuse(const std::string& path, const std::string& field, const Error& reason) {
        changes_.refused.push_back({path, field, reason});
    }

    // --- specs

    void compareSpecs() {
        std::vector<std::string> removed;
        for (const SeenSpec& spec : seen_) {
            const auto kind = shown_.kind(spec.path);
            if (kind && kind != spec.kind) removed.push_back(spec.path);
            if (kind == spec.kind) addRemoved(spec, removed);
        }
        findMoves(removed);
        for (const std::string& path : removed)
            if (const auto done = record(path, DeleteSpec{}); !done) refuse(path, {}, done.error());
        for (const auto& [from, to] : moves_) {
            const auto last = specpath::last(to);
            if (const auto done =
                    record(from, MoveSpec{{specpath::parent(to), {}}, std::string(last.name)});
                !done)
                refuse(to, {}, done.error());
        }
        for (const SeenSpec& spec : seen_)
            if (!doc().has(spec.path))
                if (const auto done = record(spec.path, CreateSpec{spec.kind}); !done)
                    refuse(spec.path, {}, done.error());
    }

    // Adds the children that the editor's layer does not have.
    void addRemoved(const SeenSpec& spec, std::vector<std::string>& removed) const {
        for (const ChildList list : {ChildList::Prims, ChildList::Properties,
                                     ChildList::VariantSets, ChildList::Variants}) {
            const auto held = shown_.children(spec.path, list);
            const auto& names = spec.children[std::size_t(list)];
            if (held == names) continue;
            const std::unordered_set<std::string_view> there(names.begin(), names.end());
            for (const std::string& name : held) {
                const std::string path = specpath::child(spec.path, list, name);
                if (!there.contains(name) && !keeps_(path, {}, {})) removed.push_back(path);
            }
        }
    }

    // Takes the specs that were moved out of `removed`.
    void findMoves(std::vector<std::string>& removed) {
        if (removed.empty()) return;
        std::multimap<std::string, std::size_t> created;  // by shape
        std::unordered_set<std::string_view> below;
        for (std::size_t i = 0; i < seen_.size(); ++i) {
            const SeenSpec& spec = seen_[i];
            if (spec.path == "/" || shown_.kind(spec.path) == spec.kind) continue;
            const bool isRoot = !below.contains(specpath::parent(spec.path));
            below.insert(spec.path);
            if (isRoot && isMovable(spec.kind)) created.emplace(shapeOf(i), i);
        }
        if (created.empty()) return;
        std::map<std::string, std::vector<std::string>> gone;
        for (const std::string& path : removed)
            if (isMovable(*shown_.kind(path))) gone[shapeOf(path)].push_back(path);
        std::set<std::string> moved;
        for (const auto& [shape, paths] : gone) {
            if (paths.size() != 1 || created.count(shape) != 1) continue;
            const std::size_t to = created.find(shape)->second;
            if (seenAt(paths[0]) || shown_.has(seen_[to].path) || !isSame(paths[0], to)) continue;
            moves_.emplace_back(paths[0], seen_[to].path);
            moved.insert(paths[0]);
        }
        std::erase_if(removed, [&](const std::string& path) { return moved.contains(path); });
    }
    [[nodiscard]] static bool isMovable(SpecKind kind) {
        return kind == SpecKind::Prim || kind == SpecKind::Attribute ||
               kind == SpecKind::Relationship;
    }
    // The kinds and relative paths of a spec and everything below it.
    [[nodiscard]] std::string shapeOf(std::size_t index) const {
        std::set<std::string> lines;
        forSeenBelow(index, [&](const SeenSpec& spec) {
            lines.insert(spec.path.substr(seen_[index].path.size()) + ' ' +
                         std::to_string(int(spec.kind)));
        });
        return joined(lines);
    }
    [[nodiscard]] std::string shapeOf(const std::string& path) const {
        std::set<std::string> lines;
        shown_.visit(path, [&](const LayerDoc::SpecView& spec) {
            lines.insert(std::string(spec.path.substr(path.size())) + ' ' +
                         std::to_string(int(spec.kind)));
        });
        return joined(lines);
    }
    [[nodiscard]] static std::string joined(const std::set<std::string>& lines) {
        std::string all;
        for (const auto& line : lines) all += line + '\n';
        return all;
    }
    template <class Visit>
    void forSeenBelow(std::size_t index, const Visit& visit) const {
        for (std::size_t i = index;
             i < seen_.size() && specpath::hasPrefix(seen_[i].path, seen_[index].path); ++i)
            visit(seen_[i]);
    }
    // Precondition: both have the same shape.
    [[nodiscard]] bool isSame(const std::string& from, std::size_t index) const {
        bool same = true;
        forSeenBelow(index, [&](const SeenSpec& spec) {
            if (!same) return;
            const std::string held = from + spec.path.substr(seen_[index].path.size());
            std::set<std::string_view> fields;
            for (const auto& [field, bytes] : spec.fields) {
                const FieldValue* value = shown_.field(held, field);
                same = same && value && isEncoded(*value, bytes);
                fields.insert(field);
            }
            for (const std::string& field : shown_.fieldNames(held))
                same = same && (fields.contains(field) ||
                                stays(spec.path, field, *shown_.field(held, field)));
        });
        return same;
    }

    // --- fields

    // Compares without decoding. Big values are inline in `bytes`.
    [[nodiscard]] bool isEncoded(const FieldValue& value, ByteView bytes) const {
        const Bytes encoded = encodeFieldValue(value);
        if (std::ranges::equal(encoded, bytes)) return true;
        bool isBig = false;
        forEachBlob(value, [&](const Value&) { isBig = true; });
        if (!isBig) return false;
        std::vector<Hash> missing;
        const auto whole = encodedInline(value, source_, missing);
        return whole && std::ranges::equal(*whole, bytes);
    }

    // Returns whether content that the editor's layer does not have stays.
    [[nodiscard]] bool stays(const std::string& path, const std::string& field,
                             const FieldValue& value) const {
        std::vector<Hash> missing;
        const auto bytes = encodedInline(value, source_, missing);
        return !bytes || keeps_(path, field, *bytes);
    }

    void compareFields(const SeenSpec& spec) {
        std::set<std::string_view> present;
        for (const auto& [field, bytes] : spec.fields) {
            present.insert(field);
            // The type comes first, because other fields must fit it.
            if (field == kTypeNameField) compareField(spec, field, bytes);
        }
        for (const auto& [field, bytes] : spec.fields)
            if (field != kTypeNameField) compareField(spec, field, bytes);
        for (const std::string& field : doc().fieldNames(spec.path)) {
            if (present.contains(field)) continue;
            if (stays(spec.path, field, *doc().field(spec.path, field))) continue;
            if (const auto done = record(spec.path, EraseField{field, {}}); !done)
                refuse(spec.path, field, done.error());
        }
    }

    void compareField(const SeenSpec& spec, const std::string& field, ByteView bytes) {
        const FieldValue* held = doc().field(spec.path, field);
        if (held && isEncoded(*held, bytes)) return;
        const auto wanted = withBlobs(bytes, blobs_);
        if (!wanted) return refuse(spec.path, field, wanted.error());
        if (!held && saysNothing(field, *wanted)) return;  // ED10
        const bool isNew = shown_.kind(spec.path) != spec.kind;
        if (!held && (!isNew || spec.kind == SpecKind::Variant) &&
            isFallback(spec.kind, field, *wanted))
            return;
        for (EditAction& action : authoredParts(field, held, &*wanted)) {
            if (erasesWhatStays(spec.path, field, action)) continue;
            if (const auto done = record(spec.path, std::move(action)); !done)
                return refuse(spec.path, field, done.error());
        }
    }

    // A part that the editor's OpenUSD cannot express is not in its layer, and was not erased.
    [[nodiscard]] bool erasesWhatStays(const std::string& path, const std::string& field,
                                       const EditAction& action) {
        const auto* erase = std::get_if<EraseField>(&action);
        const FieldValue* held = erase ? doc().field(path, field) : nullptr;
        if (!held) return false;
        if (const auto* sample = std::get_if<SampleTime>(&erase->part)) {
            const auto* samples = held->as<TimeSamples>();
            return samples && stays(path, field, samples->samples.at(sample->time));
        }
        if (const auto* key = std::get_if<DictionaryKey>(&erase->part)) {
            const auto* entry = entryAt(held->as<Dictionary>(), key->path);
            return entry &&
                   std::visit([&](const auto& each) { return stays(path, field, each); }, *entry);
        }
        return false;
    }

    // --- order

    void compareOrders() {
        for (const SeenSpec& spec : seen_)
            for (const ChildList list : kOrderedLists)
                compareOrder(spec.path, list, spec.children[std::size_t(list)]);
    }

    void compareOrder(const std::string& parent, ChildList list,
                      const std::vector<std::string>& wanted) {
        const auto held = doc().children(parent, list);
        if (held == wanted ||
            !std::is_permutation(held.begin(), held.end(), wanted.begin(), wanted.end()))
            return;
        for (const auto& [name, before] : placements(held, wanted)) {
            const std::string path = specpath::child(parent, list, name);
            if (const auto done = record(path, PlaceSpec{before}); !done)
                refuse(path, {}, done.error());
        }
    }

    const LayerId& layer_;
    const LayerDoc& shown_;
    const std::vector<SeenSpec>& seen_;
    const Keeps& keeps_;
    BlobSink& blobs_;
    BlobSource& source_;
    std::unordered_map<std::string_view, std::size_t> indexes_;
    std::vector<std::pair<std::string, std::string>> moves_;
    LayerChanges changes_;
};

}  // namespace

LayerChanges compareLayer(
    const LayerId& layer, const LayerDoc& shown, const std::vector<SeenSpec>& seen,
    const std::function<bool(std::string_view path, std::string_view field, const Bytes&)>& keeps,
    BlobSink& blobs, BlobSource& source) {
    return Comparison(layer, shown, seen, keeps, blobs, source).compare();
}

std::optional<Bytes> encodedInline(const FieldValue& value, BlobSource& source,
                                   std::vector<Hash>& missing) {
    FieldValue whole = value;
    const std::size_t before = missing.size();
    static_cast<void>(changeLeaves(whole, [&](Value& leaf) -> Result<void> {
        if (!leaf.isBlob()) return {};
        if (const SharedBytes bytes = source.blob(leaf.hash()))
            leaf = Value(leaf.type(), ByteView(*bytes));
        else
            missing.push_back(leaf.hash());
        return {};
    }));
    if (missing.size() != before) return std::nullopt;
    return encodeFieldValue(whole);
}

}  // namespace usdlive::client
