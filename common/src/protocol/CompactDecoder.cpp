// Compact frames from bytes: everything is verified before it is used (FR9-FR11).
#include <algorithm>

#include "CompactBytes.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive {

namespace {

constexpr std::size_t kLeastEditBytes = 2;  // the first byte and a path

class CompactDecoder {
public:
    CompactDecoder(ByteView frame, std::vector<std::string>& names)
        : in_(frame), budget_(frame.size()), names_(names) {}

    CompactContent decode() {
        CompactContent content = this->content(compact::Kind(in_.u8()));
        in_.finish();
        return content;
    }

private:
    CompactContent content(compact::Kind kind) {
        switch (kind) {
            case compact::Kind::Submit:
                return submit();
            case compact::Kind::Commit:
                return commit();
            case compact::Kind::Acceptance:
                return acceptance();
            case compact::Kind::Preview:
                return preview();
            case compact::Kind::Names:
                return newNames();
        }
        stop(ErrorCode::UnknownFrame, "a compact frame of a kind that this version does not know");
    }

    SubmitFrame submit() {
        SubmitFrame frame;
        frame.transaction.id.sequence = in_.varint();
        require(frame.transaction.id.sequence != 0, "a transaction has no number");
        frame.transaction.base = in_.varint();
        frame.transaction.gesture = in_.varint();
        frame.transaction.edits = edits();
        return frame;
    }
    CompactCommit commit() {
        CompactCommit result;
        Commit& commit = result.commit;
        commit.revision = in_.varint();
        commit.epoch = in_.varint();
        commit.id.client = client();
        commit.id.sequence = in_.varint();
        commit.user = {std::string(name())};
        commit.timeMs = std::int64_t(in_.varint());
        commit.gesture = in_.varint();
        commit.edits = edits();
        const std::size_t dropped = in_.count(kMaxCompactEdits, kLeastEditBytes);
        for (std::size_t index = 0; index < dropped; ++index) {
            const std::uint32_t number = in_.u32();
            // A code of a newer version: the message still explains it.
            const ErrorCode reason = errorFromName(name()).value_or(ErrorCode::Internal);
            commit.dropped.push_back({number, reason, edit()});
        }
        commit.previous = in_.hash(compact::kPreviousBytes);
        result.hashAfter = in_.hash();
        return result;
    }
    Acceptance acceptance() {
        Acceptance result;
        result.revision = in_.varint();
        result.epoch = in_.varint();
        result.sequence = in_.varint();
        result.timeMs = std::int64_t(in_.varint());
        result.previous = in_.hash(compact::kPreviousBytes);
        result.hashAfter = in_.hash();
        return result;
    }
    PreviewFrame preview() {
        PreviewFrame frame;
        frame.author = client();
        frame.gesture = in_.varint();
        frame.base = in_.varint();
        frame.edits = edits();
        return frame;
    }
    std::monostate newNames() {
        const std::size_t count = in_.count(kMaxNames, 2);
        for (std::size_t index = 0; index < count; ++index) {
            const std::uint32_t number = in_.u32();
            require(number < kMaxNames, "a name has a number that is too high");
            const std::uint64_t size = in_.varint();
            require(size > 0 && size <= kMaxNameBytes, "a name with a number is empty or too long");
            const std::string_view text = budget_.text(asText(in_.take(size)));
            if (names_.size() <= number) names_.resize(number + 1);
            names_[number] = text;
        }
        return {};
    }

    std::string_view numbered(std::uint64_t number) {
        require(number < names_.size() && !names_[number].empty(),
                "a frame uses an unknown number");
        return names_[number];
    }
    /// Valid until names are added.
    std::string_view name() { return name(in_.varint()); }
    std::string_view name(std::uint64_t code) {
        return budget_.text(code & 1 ? numbered(code >> 1) : asText(in_.take(code >> 1)));
    }
    ClientId client() {
        const std::string_view id = name();
        require(id.size() <= 64, "a client's id is longer than 64 bytes");
        return {std::string(id)};
    }
    const std::string& path() {
        const std::uint64_t code = in_.varint();
        if (code == 0) {
            budget_.spend(path_.size());
        } else if (((code - 1) & 1) != 0) {
            path_ = name(code - 1);
        } else {
            const std::size_t shared = in_.u8();
            require(shared <= path_.size(), "a path shares more than the path before it has");
            const std::string_view rest = asText(in_.take((code - 1) >> 1));
            budget_.spend(shared);
            path_.resize(shared);
            path_ += rest;
            (void)budget_.text(path_);
        }
        return path_;
    }
    Creation creation() {
        const std::uint64_t sequence = in_.varint();
        require(sequence != 0, "an address names an edit of no transaction");
        return {sequence, in_.u32()};
    }
    /// The V10 encoding of the next value.
    ByteView encodedValue() {
        const std::uint64_t code = in_.varint();
        require(code >> 1 <= UINT16_MAX, "a value is of an unknown type");
        const std::uint64_t size = in_.varint();
        const bool isBlob = (code & 1) != 0;
        scratch_.clear();
        appendNumber<std::uint16_t>(scratch_, std::uint16_t(code >> 1));
        appendNumber<std::uint8_t>(scratch_, isBlob ? 1 : 0);
        appendNumber<std::uint64_t>(scratch_, size);
        appendBytes(scratch_, in_.take(isBlob ? sizeof(Hash) : size));
        return scratch_;
    }
    FieldValue value() { return budget_.content(encodedValue()); }
    Value leaf() { return budget_.leaf(encodedValue()); }

    std::vector<Edit> edits() {
        std::vector<Edit> result;
        const std::size_t count = in_.count(kMaxCompactEdits, kLeastEditBytes);
        result.reserve(count);
        for (std::size_t index = 0; index < count; ++index) result.push_back(edit());
        return result;
    }
    Edit edit() {
        budget_.spend(DecodingBudget::kEditBytes);
        const std::uint8_t first = in_.u8();
        if ((first & compact::kOtherLayer) != 0) {
            auto layer = parseLayerId(name());
            if (!layer) throw Undecodable{layer.error()};
            layer_ = std::move(*layer);
        }
        require(!layer_.empty(), "an edit names no layer");
        budget_.spend(std::min(layer_.value.size(), DecodingBudget::kCountedLayerBytes));
        Edit edit{layer_, {}, {}};
        if ((first & compact::kHasCreation) != 0) edit.address.creation = creation();
        edit.address.path = path();
        edit.action = action(compact::Action(first & compact::kFieldMask),
                             compact::PartKind(first >> compact::kPartShift & compact::kFieldMask));
        return edit;
    }
    EditAction action(compact::Action action, compact::PartKind part) {
        using compact::Action;
        require(part == compact::PartKind::None || action == Action::Set || action == Action::Erase,
                "an edit has a part where there is none");
        switch (action) {
            case Action::Create:
                return CreateSpec{checkedKind(in_.u8())};
            case Action::Delete:
                return DeleteSpec{};
            case Action::Move: {
                MoveSpec move;
                const std::uint8_t hasCreation = in_.u8();
                require(hasCreation <= 1, "an address is of an unknown kind");
                if (hasCreation == 1) move.parent.creation = creation();
                move.parent.path = name();
                move.name = name();
                return move;
            }
            case Action::Place:
                return PlaceSpec{std::string(name())};
            case Action::Set: {
                SetField set;
                set.field = checkedField(name());
                set.form = this->part(part, set.part);
                if (part != compact::PartKind::ListItem) set.value = value();
                return set;
            }
            case Action::Erase: {
                EraseField erase;
                erase.field = checkedField(name());
                require(this->part(part, erase.part) == ValueType::None,
                        "a form is given where there is none");
                return erase;
            }
        }
        stop(ErrorCode::MalformedFrame, "an edit is of an unknown kind");
    }
    /// Returns the form, if there is one.
    ValueType part(compact::PartKind kind, FieldPart& part) {
        switch (kind) {
            case compact::PartKind::None:
                return ValueType::None;
            case compact::PartKind::DictionaryKey: {
                const std::uint64_t parts = in_.varint();
                checkKeyParts(parts);
                budget_.spend(parts, DecodingBudget::kTextBytes);
                auto& path = part.emplace<DictionaryKey>().path;
                for (std::uint64_t index = 0; index < parts; ++index) path.emplace_back(name());
                return ValueType::None;
            }
            case compact::PartKind::SampleTime:
                part = checkedTime(in_.f64());
                return ValueType::None;
            case compact::PartKind::ListItem: {
                const std::uint8_t first = in_.u8();
                ListItem item{checkedList(first & compact::kListMask), leaf(), {}};
                if ((first & compact::kHasBefore) != 0) item.before = leaf();
                const bool hasForm = (first & compact::kHasForm) != 0;
                const ValueType form = hasForm ? item.item.type() : ValueType::None;
                part = std::move(item);
                return form;
            }
            case compact::PartKind::MapKey: {
                const std::uint8_t hasForm = in_.u8();
                require(hasForm == 0 || hasForm == compact::kHasForm,
                        "a key is of an unknown kind");
                MapKey key{leaf()};
                const ValueType form = hasForm != 0 ? key.key.type() : ValueType::None;
                part = std::move(key);
                return form;
            }
        }
        stop(ErrorCode::MalformedFrame, "a part of a field is of an unknown kind");
    }

    compact::BytesIn in_;
    DecodingBudget budget_;
    std::vector<std::string>& names_;
    LayerId layer_;  // layer and path of the edit before
    std::string path_;
    Bytes scratch_;
};

}  // namespace

bool isCompact(ByteView frame) { return !frame.empty() && frame[0] % 2 == 1; }

bool beginsLike(const Hash& beginning, const Hash& hash) {
    return std::equal(beginning.bytes.begin(),
                      beginning.bytes.begin() + std::ptrdiff_t(compact::kPreviousBytes),
                      hash.bytes.begin());
}

Result<CompactContent> CompactReader::read(ByteView frame) {
    try {
        return CompactDecoder(frame, names_).decode();
    } catch (const Undecodable& stopped) {
        return tl::unexpected(stopped.error);
    }
}

}  // namespace usdlive
