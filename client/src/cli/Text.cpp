// Formats edits, commits, states and reports as text.
#include "cli/Text.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <string_view>

#include "cli/ValueShape.h"

namespace usdlive::cli {

namespace {

constexpr std::size_t kMaxText = 60;  // length of one printed value

// Cuts only between characters.
std::string shortened(std::string_view text) {
    if (text.size() <= kMaxText) return std::string(text);
    std::size_t end = kMaxText;
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) --end;
    return std::string(text.substr(0, end)) + "...";
}

/// Returns a text that fits on a line, without control characters.
std::string printable(std::string_view text) { return withoutControls(shortened(text)); }

std::string inQuotes(std::string_view text, char quote) { return quote + printable(text) + quote; }

std::string tupleText(const Value& value, const Shape& shape) {
    ByteReader bytes(value.bytes());
    std::string text;
    for (int i = 0; i < shape.count; ++i)
        text += (i ? ", " : "") +
                readElement(bytes, shape.element, [](auto element) { return number(element); });
    return shape.count == 1 ? text : "(" + text + ")";
}

// Returns `@asset@</prim>`, which are the first two parts of both types.
std::string arcText(const Value& value) {
    ByteReader bytes(value.bytes());
    const auto asset = bytes.text();
    const auto prim = value.type() == ValueType::SubLayer ? std::string_view() : bytes.text();
    std::string text;
    if (!asset.empty() || prim.empty()) text += inQuotes(asset, '@');
    if (!prim.empty()) text += "<" + shortened(prim) + ">";
    return text;
}

std::string arrayText(const Value& value) {
    const auto name = std::string(shapeOf(scalarOf(value.type())).name);
    if (isArrayEdit(value.type())) return name + "[] edit";
    if (value.isBlob()) return name + "[] of " + number(value.size() / 1024) + " KiB";
    return name + "[" + number(ByteReader(value.bytes()).u64()) + "]";
}

std::string valueText(const Value& value) {
    if (value.type() != scalarOf(value.type())) return arrayText(value);
    const Shape shape = shapeOf(value.type());
    if (value.isBlob())
        return std::string(shape.name) + " of " + number(value.size() / 1024) + " KiB";
    if (shape.element != Element::None) return tupleText(value, shape);
    switch (value.type()) {
        case ValueType::Asset:
            return inQuotes(textOf(value).value_or(""), '@');
        case ValueType::Path:
            return "<" + shortened(textOf(value).value_or("")) + ">";
        case ValueType::Reference:
        case ValueType::Payload:
        case ValueType::SubLayer:
            return arcText(value);
        default:
            break;
    }
    if (const auto name = enumText(value.type(), value.bytes())) return std::string(*name);
    if (const auto text = textOf(value)) return inQuotes(*text, '"');
    return std::string(shape.name);
}

std::string listText(const ListOp& list) {
    constexpr std::array<std::string_view, kListNames> kVerbs{"",        "add ",    "prepend ",
                                                              "append ", "delete ", "reorder "};
    std::string text;
    for (std::size_t i = 0; i < kListNames; ++i) {
        if (list.lists[i].empty() && !(list.isExplicit && i == 0)) continue;
        std::string items;
        for (const auto& item : list.lists[i])
            items += (items.empty() ? "" : ", ") + valueText(item);
        text += (text.empty() ? "" : "; ") + std::string(kVerbs[i]) + "[" + items + "]";
    }
    return shortened(text.empty() ? "[]" : text);
}

std::string mapText(const Map& map) {
    std::string text;
    for (const auto& [key, value] : map.entries)
        text += (text.empty() ? "" : ", ") + valueText(key) + ": " + valueText(value);
    return "{" + shortened(text) + "}";
}

struct Contents {
    std::string operator()(const Value& value) const { return valueText(value); }
    std::string operator()(const Dictionary& value) const {
        std::string keys;
        for (const auto& [key, entry] : value.entries) keys += (keys.empty() ? "" : ", ") + key;
        return "{" + shortened(keys) + "}";
    }
    std::string operator()(const TimeSamples& value) const {
        return counted(value.samples.size(), "sample");
    }
    std::string operator()(const ListOp& value) const { return listText(value); }
    std::string operator()(const Map& value) const { return mapText(value); }
};

struct Parts {
    std::string operator()(std::monostate) const { return {}; }
    std::string operator()(const DictionaryKey& part) const {
        std::string keys;
        for (const auto& key : part.path) keys += "[" + inQuotes(key, '"') + "]";
        return keys;
    }
    std::string operator()(const SampleTime& part) const { return " at " + number(part.time); }
    std::string operator()(const ListItem& part) const {
        return " " + std::string(kListOpNames[std::size_t(part.list)]) + " " + valueText(part.item);
    }
    std::string operator()(const MapKey& part) const { return "[" + valueText(part.key) + "]"; }
};

struct Actions {
    std::string operator()(const CreateSpec& action) const {
        return "  (" + std::string(specKindName(action.kind)) + ")";
    }
    std::string operator()(const DeleteSpec&) const { return {}; }
    std::string operator()(const MoveSpec& action) const {
        const auto& parent = action.parent.path;
        const auto list = specpath::last(path).list;
        return "  ->  " + specpath::child(parent, list, action.name);
    }
    std::string operator()(const PlaceSpec& action) const {
        return action.before.empty() ? "  last" : "  before " + action.before;
    }
    std::string operator()(const SetField& action) const {
        const auto where = "  " + action.field + std::visit(Parts{}, action.part);
        // A list item is its own value.
        if (std::holds_alternative<ListItem>(action.part)) return where;
        return where + " = " + describe(action.value);
    }
    std::string operator()(const EraseField& action) const {
        return "  " + action.field + std::visit(Parts{}, action.part);
    }
    std::string_view path;
};

std::string timeText(std::int64_t timeMs) {
    const std::time_t seconds = timeMs / 1000;
    std::tm local{};
    localtime_r(&seconds, &local);
    char text[32];
    std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S", &local);
    return text;
}

std::string padded(std::string_view text, std::size_t width) {
    return std::string(text) + std::string(text.size() < width ? width - text.size() : 0, ' ');
}

/// Returns the beginning of a line about a revision.
std::string whoAndWhen(Revision revision, std::uint64_t timeMs, const std::string& user,
                       const Palette& palette) {
    return palette.paint("#" + padded(number(revision), 7), Colour::Yellow) +
           palette.paint(timeText(std::int64_t(timeMs)), Colour::Dim) + "  " +
           palette.paint(padded(user.empty() ? "-" : user, 10), Colour::Cyan);
}

/// Returns a size with a unit.
std::string sizeText(std::uint64_t bytes) {
    constexpr std::array<const char*, 5> kUnits{"B", "KiB", "MiB", "GiB", "TiB"};
    double size = double(bytes);
    std::size_t unit = 0;
    for (; size >= 1024 && unit + 1 < kUnits.size(); ++unit) size /= 1024;
    char text[32];
    std::snprintf(text, sizeof text, unit == 0 ? "%.0f %s" : "%.1f %s", size, kUnits[unit]);
    return text;
}

}  // namespace

std::string counted(std::size_t count, const std::string& what) {
    return number(count) + " " + what + (count == 1 ? "" : "s");
}

std::string withoutControls(std::string_view text) {
    std::string out;
    for (const char c : text)
        if (c == '\n')
            out += "\\n";
        else
            out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
    return out;
}

std::string describe(const FieldValue& value) { return value.visit(Contents{}); }

std::string describe(const Edit& edit) {
    return padded(kActionNames[edit.action.index()], 7) + edit.address.path +
           std::visit(Actions{edit.address.path}, edit.action);
}

bool concerns(const Commit& commit, const LayerId& layer) {
    return layer.empty() || commit.imported == layer ||
           std::any_of(commit.edits.begin(), commit.edits.end(),
                       [&](const Edit& edit) { return edit.layer == layer; });
}

std::string describe(const Commit& commit, std::size_t maxEdits, const LayerId& layer,
                     const Palette& palette) {
    std::string text =
        whoAndWhen(commit.revision, commit.timeMs, printable(commit.user.value), palette);
    if (commit.imported) return text + "  imported " + commit.imported->value + " from its file\n";
    text += "  " + counted(commit.edits.size(), "edit");
    if (!commit.dropped.empty()) text += ", " + number(commit.dropped.size()) + " dropped";
    if (!commit.label.empty()) text += "  " + printable(commit.label);
    text += "\n";
    std::size_t shown = 0;
    for (const Edit& edit : commit.edits) {
        if (!layer.empty() && edit.layer != layer) continue;
        if (shown++ < maxEdits) text += "    " + edit.layer.value + "  " + describe(edit) + "\n";
    }
    if (shown > maxEdits) text += "    and " + number(shown - maxEdits) + " more\n";
    return text;
}

std::string describe(const Checkpoint& checkpoint, const Palette& palette) {
    return whoAndWhen(checkpoint.revision, checkpoint.timeMs, printable(checkpoint.user.value),
                      palette) +
           "  " + printable(checkpoint.name) + "\n";
}

namespace {

class Tree {
public:
    Tree(const LayerDoc& doc, const Palette& palette) : doc_(doc), palette_(palette) {}

    std::string text() {
        below("/", "");
        return std::move(text_);
    }

private:
    struct Branch {
        std::string path, label;
    };

    [[nodiscard]] std::string fieldText(const std::string& path, std::string_view name) const {
        const FieldValue* field = doc_.field(path, name);
        const Value* value = field ? field->as<Value>() : nullptr;
        if (!value) return {};
        return std::string(textOf(*value).value_or(""));
    }

    [[nodiscard]] std::string primLabel(const std::string& path, const std::string& name) const {
        std::string label = name;
        if (const auto type = fieldText(path, "typeName"); !type.empty())
            label += "  " + palette_.paint(type, Colour::Dim);
        const FieldValue* specifier = doc_.field(path, "specifier");
        const std::string how = specifier ? describe(*specifier) : "over";
        return how == "def" ? label : label + "  (" + how + ")";
    }

    [[nodiscard]] std::vector<Branch> branches(const std::string& path) const {
        std::vector<Branch> branches;
        for (const auto& set : doc_.children(path, ChildList::VariantSets)) {
            const auto setPath = specpath::child(path, ChildList::VariantSets, set);
            for (const auto& variant : doc_.children(setPath, ChildList::Variants))
                branches.push_back({specpath::child(setPath, ChildList::Variants, variant),
                                    "{" + set + "=" + variant + "}"});
        }
        for (const auto& name : doc_.children(path, ChildList::Prims)) {
            const auto child = specpath::child(path, ChildList::Prims, name);
            branches.push_back({child, primLabel(child, name)});
        }
        return branches;
    }

    void below(const std::string& path, const std::string& indent) {
        const auto all = branches(path);
        for (std::size_t i = 0; i < all.size(); ++i) {
            const bool last = i + 1 == all.size();
            text_ += indent + (last ? "└─ " : "├─ ") + all[i].label + "\n";
            below(all[i].path, indent + (last ? "   " : "│  "));
        }
    }

    const LayerDoc& doc_;
    const Palette& palette_;
    std::string text_;
};

}  // namespace

std::string describe(const BlamedOpinion& opinion, Revision base, const Palette& palette) {
    constexpr std::size_t kWidth = 40;  // the width of the other form
    if (opinion.revision == 0)
        return palette.paint(padded("before #" + number(base + 1), kWidth), Colour::Dim);
    const std::string user = opinion.isImport ? "(file)" : printable(opinion.user.value);
    return whoAndWhen(opinion.revision, std::uint64_t(opinion.timeMs), user, palette);
}

std::string describe(const LayerState& state, const Palette& palette) {
    std::vector<std::string> parts;
    if (state.dirty) parts.emplace_back("changed");
    if (state.outdated) parts.emplace_back("outdated: its file was changed");
    if (!state.writable) parts.emplace_back("read-only");
    if (state.globallyMuted) parts.emplace_back("muted");
    if (state.locked)
        parts.push_back(state.holder.empty() ? "locked"
                                             : "locked by " + printable(state.holder.value));
    if (!state.editors.empty()) {
        std::string open = "open:";
        for (const UserName& user : state.editors) open += " " + printable(user.value);
        parts.push_back(std::move(open));
    }
    std::string text;
    for (const std::string& part : parts) text += (text.empty() ? "  " : ", ") + part;
    return palette.paint(text, Colour::Dim);
}

std::string describe(const Presence& presence, const Palette& palette) {
    std::string text = palette.paint(printable(presence.user.value), Colour::Cyan);
    if (!presence.application.empty()) text += "  " + printable(presence.application);
    if (!presence.selection.empty()) text += "  " + printable(presence.selection.front());
    if (presence.selection.size() > 1)
        text += " and " + number(presence.selection.size() - 1) + " more";
    if (!presence.editTarget.empty()) text += "  in " + printable(presence.editTarget);
    if (presence.time) text += "  at " + number(*presence.time);
    return text;
}

std::string describe(const HistoryCompacted& done) {
    std::string text;
    if (done.replaced > 0)
        text = counted(done.replaced, "commit") + " replaced; the log takes " +
               sizeText(done.bytesAfter) + ", before " + sizeText(done.bytesBefore) + "\n";
    else
        text = "no commit was replaced\n";
    if (done.base > 0) text += "the history begins at revision " + std::to_string(done.base) + "\n";
    if (!done.keptFor.empty()) text += "older commits are kept for " + done.keptFor + "\n";
    return text;
}

std::string describe(const Storage& storage, const Palette& palette) {
    std::string text;
    const auto add = [&](std::uint64_t bytes, const std::string& what) {
        const std::string size = sizeText(bytes);
        text +=
            std::string(size.size() < 10 ? 10 - size.size() : 0, ' ') + size + "  " + what + "\n";
    };
    const Revision commits = storage.revision - storage.base;
    std::string log = "log: " + counted(commits, "commit");
    if (commits > 0) log += " since " + timeText(std::int64_t(storage.oldestMs));
    if (storage.base > 0) log += "; older ones were replaced by a base";
    add(storage.log, log);
    if (storage.base > 0)
        add(storage.bases, "base: the layers at revision " + std::to_string(storage.base));
    add(storage.snapshots, "snapshots of layers, to load them quickly");
    add(storage.blobBytes, "big values: " + std::to_string(storage.blobs));
    add(storage.clients, "transactions of clients");
    add(storage.records, "other records");
    add(storage.free, "free");
    std::vector<LayerStorage> layers = storage.layers;
    const auto all = [](const LayerStorage& layer) {
        return layer.log + layer.base + layer.snapshots + layer.blobBytes;
    };
    std::stable_sort(layers.begin(), layers.end(),
                     [&](const auto& a, const auto& b) { return all(a) > all(b); });
    for (const LayerStorage& layer : layers)
        add(all(layer), palette.paint(printable(layer.layer.value), Colour::Bold) + ": " +
                            counted(layer.commits, "commit") + " " + sizeText(layer.log) +
                            ", base " + sizeText(layer.base) + ", snapshot " +
                            sizeText(layer.snapshots) + ", " + counted(layer.blobs, "big value") +
                            " " + sizeText(layer.blobBytes));
    return text;
}

std::string describe(const SkippedFile& file) {
    return withoutControls(file.path) + "  " + withoutControls(file.reason);
}

std::string describe(const client::event::Progress& progress) {
    constexpr std::array<const char*, 5> kVerbs{"importing", "saving", "uploading", "fetching",
                                                "opening"};
    return std::string(kVerbs[std::size_t(progress.task)]) + " " + printable(progress.layer.value);
}

std::string describeTree(const LayerDoc& doc, const Palette& palette) {
    return Tree(doc, palette).text();
}

}  // namespace usdlive::cli
