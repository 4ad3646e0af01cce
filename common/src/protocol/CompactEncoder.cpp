// Compact frames to bytes (FR9).
#include <algorithm>

#include "CompactBytes.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/protocol/CompactFrame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive {

namespace {

// FR7: bytes of the texts of a frame, each counted as often as it occurs. A decoder accepts a frame
// with so many.
constexpr std::size_t kMaxTexts = 8 * 1024 * 1024;

class CompactEncoder {
public:
    CompactEncoder(compact::Kind kind, NameNumbers& names) : out_(kind), names_(names) {
        names_.beginFrame();
    }

    std::optional<CompactFrame> encode(const Transaction& transaction) {
        out_.varint(transaction.id.sequence);
        out_.varint(transaction.base);
        out_.varint(transaction.gesture);
        edits(transaction.edits);
        return finish();
    }
    std::optional<CompactFrame> encode(const PreviewFrame& preview) {
        name(preview.author.value);
        out_.varint(preview.gesture);
        out_.varint(preview.base);
        edits(preview.edits);
        return finish();
    }
    std::optional<CompactFrame> encode(const CompactCommit& compact) {
        const Commit& commit = compact.commit;
        out_.varint(commit.revision);
        out_.varint(commit.epoch);
        name(commit.id.client.value);
        out_.varint(commit.id.sequence);
        name(commit.user.value);
        out_.varint(std::uint64_t(commit.timeMs));
        out_.varint(commit.gesture);
        edits(commit.edits);
        out_.varint(commit.dropped.size());
        for (const DroppedEdit& dropped : commit.dropped) {
            out_.varint(dropped.index);
            name(errorName(dropped.reason));
            edit(dropped.edit);
        }
        out_.bytes(ByteView(commit.previous.bytes).first(compact::kPreviousBytes));
        out_.bytes(compact.hashAfter.bytes);
        return finish();
    }

private:
    std::optional<CompactFrame> finish() {
        if (texts_ > kMaxTexts || out_.size() > kMaxCompactBytes) return std::nullopt;
        CompactFrame frame{std::make_shared<const Bytes>(out_.finish()), {}, 0};
        names_.endFrame(frame);
        return frame;
    }

    /// A number and 1, or the length and the text.
    void name(std::string_view text) {
        texts_ += text.size();
        if (const auto number = names_.numberOf(text)) return out_.varint(*number << 1 | 1);
        out_.varint(text.size() << 1);
        out_.bytes(asBytes(text));
    }
    /// 0 for the path of the edit before; otherwise as a name, and 1 more. A path that is spelled
    /// begins with so many bytes of the path before.
    void path(const std::string& path) {
        texts_ += path.size();
        if (path == path_) return out_.varint(0);
        if (const auto number = names_.numberOf(path)) {
            out_.varint((*number << 1 | 1) + 1);
        } else {
            const std::size_t most = std::min({path.size(), path_.size(), compact::kMaxShared});
            const auto end = path.begin() + std::ptrdiff_t(most);
            const auto differs = std::mismatch(path.begin(), end, path_.begin()).first;
            const auto shared = std::size_t(differs - path.begin());
            out_.varint(((path.size() - shared) << 1) + 1);
            out_.u8(std::uint8_t(shared));
            out_.bytes(asBytes(path).subspan(shared));
        }
        path_ = path;
    }
    void creation(const std::optional<Creation>& creation) {
        if (!creation) return;
        out_.varint(creation->sequence);
        out_.varint(creation->edit);
    }
    /// The type and form of the V10 encoding in one number, and the size if there is any.
    void value(const FieldValue& value) {
        scratch_.clear();
        encodeFieldValue(value, scratch_);
        ByteReader header(scratch_);
        const std::uint64_t type = header.u16(), form = header.u8();
        out_.varint(type << 1 | form);
        out_.varint(header.u64());
        out_.bytes(header.take(header.left()));
    }

    void edits(const std::vector<Edit>& edits) {
        out_.varint(edits.size());
        for (const Edit& one : edits) edit(one);
    }
    void edit(const Edit& edit) {
        const auto action = compact::Action(edit.action.index());
        const FieldPart* part = partOf(edit.action);
        std::uint8_t first = std::uint8_t(action);
        if (part) first |= std::uint8_t(part->index() << compact::kPartShift);
        const bool otherLayer = !layer_ || *layer_ != edit.layer.value;
        if (otherLayer) first |= compact::kOtherLayer;
        if (edit.address.creation) first |= compact::kHasCreation;
        out_.u8(first);
        if (otherLayer) name(edit.layer.value);
        layer_ = &edit.layer.value;
        creation(edit.address.creation);
        path(edit.address.path);
        this->action(edit.action);
    }
    static const FieldPart* partOf(const EditAction& action) {
        if (const auto* set = std::get_if<SetField>(&action)) return &set->part;
        if (const auto* erase = std::get_if<EraseField>(&action)) return &erase->part;
        return nullptr;
    }
    void action(const EditAction& action) {
        std::visit(Overloaded{
                       [&](const CreateSpec& create) { out_.u8(std::uint8_t(create.kind)); },
                       [&](const DeleteSpec&) {},
                       [&](const MoveSpec& move) {
                           out_.u8(move.parent.creation ? 1 : 0);
                           creation(move.parent.creation);
                           name(move.parent.path);
                           name(move.name);
                       },
                       [&](const PlaceSpec& place) { name(place.before); },
                       [&](const SetField& set) {
                           name(set.field);
                           part(set.part, set.form != ValueType::None);
                           if (!std::holds_alternative<ListItem>(set.part)) value(set.value);
                       },
                       [&](const EraseField& erase) {
                           name(erase.field);
                           part(erase.part, false);
                       },
                   },
                   action);
    }
    void part(const FieldPart& part, bool hasForm) {
        std::visit(Overloaded{
                       [&](const std::monostate&) {},
                       [&](const DictionaryKey& key) {
                           out_.varint(key.path.size());
                           texts_ += DecodingBudget::kTextBytes * key.path.size();
                           for (const std::string& one : key.path) name(one);
                       },
                       [&](const SampleTime& sample) { out_.f64(sample.time); },
                       [&](const ListItem& item) {
                           std::uint8_t first = std::uint8_t(item.list);
                           if (hasForm) first |= compact::kHasForm;
                           if (item.before) first |= compact::kHasBefore;
                           out_.u8(first);
                           value(item.item);
                           if (item.before) value(*item.before);
                       },
                       [&](const MapKey& key) {
                           out_.u8(hasForm ? compact::kHasForm : 0);
                           value(key.key);
                       },
                   },
                   part);
    }

    compact::BytesOut out_;
    NameNumbers& names_;
    std::size_t texts_ = 0;
    const std::string* layer_ = nullptr;  // layer and path of the edit before
    std::string path_;
    Bytes scratch_;
};

std::optional<CompactFrame> encoded(compact::Kind kind, const std::vector<Edit>& edits,
                                    const auto& content, NameNumbers& names) {
    if (!mayBeCompact(edits)) return std::nullopt;
    return CompactEncoder(kind, names).encode(content);
}

}  // namespace

bool mayBeCompact(const std::vector<Edit>& edits) {
    const auto hasMore = [](const Edit& edit) {
        return !edit.names.empty() || concernsPlace(edit.action);
    };
    return edits.size() <= kMaxCompactEdits && std::ranges::none_of(edits, hasMore) &&
           leastFrameBytes(edits) <= kMaxCompactBytes;
}

std::optional<CompactFrame> encodeCompact(const Transaction& transaction, NameNumbers& names) {
    if (transaction.seen != 0 && transaction.seen != transaction.base) return std::nullopt;
    if (!transaction.label.empty()) return std::nullopt;
    return encoded(compact::Kind::Submit, transaction.edits, transaction, names);
}

std::optional<CompactFrame> encodeCompact(const PreviewFrame& preview, NameNumbers& names) {
    return encoded(compact::Kind::Preview, preview.edits, preview, names);
}

std::optional<CompactFrame> encodeCompact(const CompactCommit& commit, NameNumbers& names) {
    if (commit.commit.dropped.size() > kMaxCompactEdits || commit.commit.firstUnseen != 0 ||
        !commit.commit.label.empty())
        return std::nullopt;
    return encoded(compact::Kind::Commit, commit.commit.edits, commit, names);
}

Bytes encodeAcceptance(const Acceptance& acceptance) {
    compact::BytesOut out(compact::Kind::Acceptance);
    out.varint(acceptance.revision);
    out.varint(acceptance.epoch);
    out.varint(acceptance.sequence);
    out.varint(std::uint64_t(acceptance.timeMs));
    out.bytes(ByteView(acceptance.previous.bytes).first(compact::kPreviousBytes));
    out.bytes(acceptance.hashAfter.bytes);
    return out.finish();
}

}  // namespace usdlive
