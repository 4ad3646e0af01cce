// Frames from bytes: everything is verified before it is used (FR3, FR7).
#include <algorithm>

#include "Decoding.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/protocol/CommitBlobs.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/frames_generated.h"

namespace usdlive {

namespace {

using Text = flatbuffers::String;
using ByteVector = flatbuffers::Vector<std::uint8_t>;
template <class T>
using TableVector = flatbuffers::Vector<flatbuffers::Offset<T>>;

/// Converts a verified FlatBuffer into our types. A FlatBuffer may refer to one text or table many
/// times, so the memory of the result is limited by the size of the frame (FR7).
class FrameDecoder {
public:
    explicit FrameDecoder(std::size_t frameBytes)
        : budget_(frameBytes), maxEdits_(frameBytes / 32) {}

    Frame decode(const wire::Frame& frame) {
        switch (frame.body_type()) {
            case wire::Body::Control:
                return ControlFrame{text(frame.body_as_Control()->json())};
            case wire::Body::Submit:
                return submit(*frame.body_as_Submit());
            case wire::Body::Commit:
                return commit(*frame.body_as_Commit());
            case wire::Body::Refusal:
                return refusal(*frame.body_as_Refusal());
            case wire::Body::Preview:
                return preview(*frame.body_as_Preview());
            case wire::Body::Snapshot:
                return snapshot(*frame.body_as_Snapshot());
            case wire::Body::Blob:
                return blob(*frame.body_as_Blob());
            case wire::Body::NONE:
                break;
        }
        stop(ErrorCode::UnknownFrame, "a frame of kind " + std::to_string(int(frame.body_type())) +
                                          ", which this version does not know");
    }

private:
    std::string_view view(const Text* text) { return budget_.text({text->c_str(), text->size()}); }
    std::string text(const Text* text) { return std::string(view(text)); }
    std::string optionalText(const Text* text) { return text ? this->text(text) : std::string(); }
    Bytes copy(const ByteVector* bytes) {
        budget_.spend(bytes->size());
        return {bytes->begin(), bytes->end()};
    }
    Hash hash(const ByteVector* bytes) {
        Hash hash;
        require(bytes->size() == hash.bytes.size(), "a hash does not have 32 bytes");
        std::copy(bytes->begin(), bytes->end(), hash.bytes.begin());
        return hash;
    }
    FieldValue content(const ByteVector* bytes) {
        return budget_.content({bytes->data(), bytes->size()});
    }
    Value leaf(const ByteVector* bytes) { return budget_.leaf({bytes->data(), bytes->size()}); }
    ErrorCode errorCode(const Text* name) {
        // A code of a newer version: the message still explains it.
        return errorFromName(view(name)).value_or(ErrorCode::Internal);
    }
    ClientId clientId(const Text* text) {
        require(text->size() <= 64, "a client's id is longer than 64 bytes");
        return {this->text(text)};
    }
    LayerId layerId(const Text* text) {
        auto layer = parseLayerId(view(text));
        if (!layer) throw Undecodable{layer.error()};
        return std::move(*layer);
    }
    void layers(const TableVector<Text>* names) {
        if (!names) return;
        budget_.spend(names->size(), DecodingBudget::kTextBytes);
        layers_.reserve(names->size());
        for (const Text* name : *names) layers_.push_back(layerId(name));
    }

    Address address(const Text* path, std::uint64_t sequence, std::uint32_t edit) {
        return checkedAddress(text(path), sequence, edit);
    }
    std::string fieldName(const Text* text) { return checkedField(view(text)); }

    FieldPart part(wire::Part type, const void* part) {
        if (type == wire::Part::NONE) return std::monostate{};
        require(part, "a part of a field is missing");
        switch (type) {
            case wire::Part::DictionaryKey:
                return dictionaryKey(*static_cast<const wire::DictionaryKey*>(part));
            case wire::Part::SampleTime:
                return checkedTime(static_cast<const wire::SampleTime*>(part)->time());
            case wire::Part::ListItem:
                return listItem(*static_cast<const wire::ListItem*>(part));
            case wire::Part::MapKey:
                return MapKey{leaf(static_cast<const wire::MapKey*>(part)->key())};
            case wire::Part::NONE:
                break;
        }
        stop(ErrorCode::MalformedFrame, "a part of a field is of an unknown kind");
    }
    DictionaryKey dictionaryKey(const wire::DictionaryKey& key) {
        checkKeyParts(key.path()->size());
        budget_.spend(key.path()->size(), DecodingBudget::kTextBytes);
        DictionaryKey result;
        for (const Text* name : *key.path()) result.path.push_back(text(name));
        return result;
    }
    ListItem listItem(const wire::ListItem& item) {
        ListItem result{checkedList(item.list()), leaf(item.item()), {}};
        if (item.before()) result.before = leaf(item.before());
        return result;
    }

    EditAction action(const wire::Edit& edit) {
        switch (edit.action_type()) {
            case wire::Action::CreateSpec:
                return CreateSpec{checkedKind(edit.action_as_CreateSpec()->kind())};
            case wire::Action::DeleteSpec:
                return DeleteSpec{edit.action_as_DeleteSpec()->place()};
            case wire::Action::MoveSpec: {
                const wire::MoveSpec& move = *edit.action_as_MoveSpec();
                const wire::Address& parent = *move.parent();
                return MoveSpec{address(parent.path(), parent.sequence(), parent.edit()),
                                text(move.name()), move.place()};
            }
            case wire::Action::PlaceSpec:
                return PlaceSpec{optionalText(edit.action_as_PlaceSpec()->before())};
            case wire::Action::SetField:
                return setField(*edit.action_as_SetField());
            case wire::Action::EraseField: {
                const wire::EraseField& erase = *edit.action_as_EraseField();
                return EraseField{fieldName(erase.field()), part(erase.part_type(), erase.part())};
            }
            case wire::Action::NONE:
                break;
        }
        stop(ErrorCode::MalformedFrame, "an edit is of an unknown kind");
    }
    SetField setField(const wire::SetField& set) {
        SetField result{fieldName(set.field()), part(set.part_type(), set.part()), {}};
        result.form = ValueType(set.form());
        if (const auto* item = std::get_if<ListItem>(&result.part)) {
            require(!set.value(), "a list item is its own value");
            checkForm(result.form, item->item);
            return result;
        }
        require(set.value(), "a field is set to no value");
        result.value = content(set.value());
        if (const auto* key = std::get_if<MapKey>(&result.part))
            checkForm(result.form, key->key);
        else
            require(result.form == ValueType::None, "a form is given where there is none");
        return result;
    }
    Edit edit(const wire::Edit& edit) {
        require(edit.layer() < layers_.size(), "an edit names no layer of the frame");
        const LayerId& layer = layers_[edit.layer()];
        budget_.spend(std::min(layer.value.size(), DecodingBudget::kCountedLayerBytes));
        Edit result{layer, address(edit.path(), edit.sequence(), edit.edit()), action(edit)};
        if (!edit.names()) return result;
        budget_.spend(edit.names()->size(), sizeof(Address));
        for (const wire::Address* name : *edit.names())
            result.names.push_back(address(name->path(), name->sequence(), name->edit()));
        return result;
    }
    std::vector<Edit> edits(const TableVector<wire::Edit>* edits) {
        std::vector<Edit> result;
        if (!edits) return result;
        require(edits->size() <= maxEdits_, "a frame refers to the same edit too often");
        budget_.spend(edits->size(), DecodingBudget::kEditBytes);
        result.reserve(edits->size());
        for (const wire::Edit* one : *edits) result.push_back(edit(*one));
        return result;
    }

    std::string label(const flatbuffers::String* written) {
        if (!written) return {};
        std::string label = text(written);
        require(label == labelOf(label), "a label is too long or has control characters");
        return label;
    }
    Frame submit(const wire::Submit& submit) {
        layers(submit.layers());
        require(submit.sequence() != 0, "a transaction has no number");
        SubmitFrame frame;
        frame.transaction.id = {clientId(submit.client()), submit.sequence()};
        frame.transaction.base = submit.base();
        frame.transaction.gesture = submit.gesture();
        frame.transaction.seen = submit.seen();
        frame.transaction.label = label(submit.label());
        frame.transaction.edits = edits(submit.edits());
        frame.part = submit.part();
        frame.more = submit.more();
        return frame;
    }
    Frame commit(const wire::Commit& commit) {
        layers(commit.layers());
        CommitFrame frame;
        Commit& result = frame.commit;
        result.revision = commit.revision();
        result.epoch = commit.epoch();
        result.id = {clientId(commit.client()), commit.sequence()};
        result.user = {text(commit.user())};
        result.timeMs = commit.time_ms();
        result.gesture = commit.gesture();
        if (commit.imported()) result.imported = layerId(commit.imported());
        result.edits = edits(commit.edits());
        if (commit.dropped()) {
            require(commit.dropped()->size() <= maxEdits_, "too many dropped edits");
            budget_.spend(commit.dropped()->size(), DecodingBudget::kEditBytes);
            for (const wire::Dropped* dropped : *commit.dropped())
                result.dropped.push_back(
                    {dropped->index(), errorCode(dropped->reason()), edit(*dropped->edit())});
        }
        result.previous = hash(commit.previous());
        result.label = label(commit.label());
        result.conflated = commit.conflated();
        result.firstUnseen = commit.first_unseen();
        require(result.firstUnseen == 0 || result.firstUnseen < result.revision,
                "a commit that says that itself was not seen");
        require(result.conflated == 0 ||
                    (result.conflated < result.revision && commit.hash_after() && !result.imported),
                "a commit that stands for others without their hash");
        if (commit.hash_after()) {
            require(result.conflated > 0 || (result.imported && result.edits.empty()),
                    "a stub of no import");
            frame.hashAfter = hash(commit.hash_after());
        }
        frame.part = commit.part();
        frame.more = commit.more();
        require((frame.part == 0 && !frame.more) || (!result.imported && !frame.hashAfter),
                "a part of a commit that has none");
        return frame;
    }
    Frame refusal(const wire::Refusal& refusal) {
        return RefusalFrame{refusal.sequence(),
                            refusal.edit(),
                            {errorCode(refusal.code()), text(refusal.message())}};
    }
    Frame preview(const wire::Preview& preview) {
        layers(preview.layers());
        return PreviewFrame{clientId(preview.author()), preview.gesture(), preview.base(),
                            edits(preview.edits())};
    }
    Frame snapshot(const wire::Snapshot& snapshot) {
        return SnapshotFrame{snapshot.request(), snapshot.index(), snapshot.last(),
                             snapshot.raw_bytes(), copy(snapshot.data())};
    }
    Frame blob(const wire::Blob& blob) {
        return BlobFrame{hash(blob.hash()), blob.size(),       blob.offset(),
                         blob.raw_bytes(),  copy(blob.data()), blob.gesture()};
    }

    DecodingBudget budget_;
    std::size_t maxEdits_;
    std::vector<LayerId> layers_;
};

/// Counts the parts of dictionary keys in a frame that is not verified yet, each as often as the
/// frame refers to it, and returns whether they are within the limit. The verifier visits every one
/// of them: a thousand edits that share a key of a million parts would take it a minute. Damaged
/// parts count nothing; the verifier finds them.
class KeyCounter {
public:
    explicit KeyCounter(ByteView frame)
        : frame_(frame),
          verifier_(frame.data(), frame.size(), unlimited()),
          left_(frame.size() / sizeof(flatbuffers::uoffset_t)) {}

    bool areFew() {
        if (verifier_.VerifyOffset(0) == 0) return true;
        const Table* frame = flatbuffers::GetRoot<Table>(frame_.data());
        const Table* body = below(frame, wire::Frame::VT_BODY);
        switch (wire::Body(kind(frame, wire::Frame::VT_BODY_TYPE))) {
            case wire::Body::Submit:
                return edits(below(body, wire::Submit::VT_EDITS));
            case wire::Body::Preview:
                return edits(below(body, wire::Preview::VT_EDITS));
            case wire::Body::Commit:
                return edits(below(body, wire::Commit::VT_EDITS)) &&
                       edits(below(body, wire::Commit::VT_DROPPED), wire::Dropped::VT_EDIT);
            default:
                return true;
        }
    }

private:
    using Table = flatbuffers::Table;

    // Disables the verifier's own limits of tables and depth.
    static flatbuffers::Verifier::Options unlimited() {
        flatbuffers::Verifier::Options options;
        options.max_depth = options.max_tables = ~flatbuffers::uoffset_t(0);
        return options;
    }

    /// Returns the target of a table's field; nullptr if there is none or it is damaged.
    const Table* below(const Table* table, flatbuffers::voffset_t field) {
        const bool there =
            table && table->VerifyTableStart(verifier_) && table->VerifyOffset(verifier_, field);
        return there ? table->GetPointer<const Table*>(field) : nullptr;
    }
    std::uint8_t kind(const Table* table, flatbuffers::voffset_t field) {
        const bool there = table && table->VerifyTableStart(verifier_) &&
                           table->VerifyField<std::uint8_t>(verifier_, field, 1);
        return there ? table->GetField<std::uint8_t>(field, 0) : 0;
    }

    /// `tables`: a vector of edits, or of tables with an edit in their field `edit`.
    bool edits(const Table* tables, flatbuffers::voffset_t edit = 0) {
        const auto* all = reinterpret_cast<const TableVector<Table>*>(tables);
        if (!all || !verifier_.VerifyVector(all)) return true;
        const std::size_t first = std::size_t(all->Data() - frame_.data());
        for (flatbuffers::uoffset_t index = 0; index < all->size(); ++index) {
            if (verifier_.VerifyOffset(first + index * sizeof index) == 0) return true;
            const Table* one = all->Get(index);
            if (!count(edit == 0 ? one : below(one, edit))) return false;
        }
        return true;
    }
    bool count(const Table* edit) {
        static_assert(int(wire::SetField::VT_PART) == int(wire::EraseField::VT_PART));
        const auto action = wire::Action(kind(edit, wire::Edit::VT_ACTION_TYPE));
        if (action != wire::Action::SetField && action != wire::Action::EraseField) return true;
        const Table* field = below(edit, wire::Edit::VT_ACTION);
        if (wire::Part(kind(field, wire::SetField::VT_PART_TYPE)) != wire::Part::DictionaryKey)
            return true;
        const auto* parts = reinterpret_cast<const TableVector<Text>*>(
            below(below(field, wire::SetField::VT_PART), wire::DictionaryKey::VT_PATH));
        if (!parts || !verifier_.VerifyVector(parts)) return true;
        if (parts->size() > left_) return false;
        left_ -= parts->size();
        return true;
    }

    ByteView frame_;
    flatbuffers::Verifier verifier_;
    std::size_t left_;
};

/// Verifies the structure of a frame and returns its root; nullptr if it is not a frame.
const wire::Frame* verified(ByteView frame) {
    if (frame.size() < kMinFrameBytes || frame.size() >= FLATBUFFERS_MAX_BUFFER_SIZE ||
        !KeyCounter(frame).areFew())
        return nullptr;
    flatbuffers::Verifier::Options options;
    options.max_depth = 16;
    // Each of our tables takes at least 8 bytes, with the offset that refers to it.
    options.max_tables = flatbuffers::uoffset_t(frame.size() / 8);
    flatbuffers::Verifier verifier(frame.data(), frame.size(), options);
    return wire::VerifyFrameBuffer(verifier) ? wire::GetFrame(frame.data()) : nullptr;
}

/// Returns the frame at an aligned address: FlatBuffers needs multiples of four. The lengths of our
/// own frames are such multiples, so only frames of others are copied.
ByteView aligned(ByteView frame, Bytes& copy) {
    if (reinterpret_cast<std::uintptr_t>(frame.data()) % sizeof(flatbuffers::uoffset_t) == 0)
        return frame;
    copy.assign(frame.begin(), frame.end());
    return copy;
}

/// Calls `visit` with each value that an edit sets.
Result<void> forEachContent(const wire::Edit& edit,
                            const std::function<void(const FieldValue&)>& visit) {
    const auto* set = edit.action_as_SetField();
    if (!set) return {};
    const auto* item = set->part_as_ListItem();
    const auto* key = set->part_as_MapKey();
    for (const ByteVector* bytes :
         {set->value(), item ? item->item() : nullptr, key ? key->key() : nullptr}) {
        if (!bytes) continue;
        const auto content = decodeFieldValue({bytes->data(), bytes->size()});
        if (!content) return tl::unexpected(content.error());
        visit(*content);
    }
    return {};
}

}  // namespace

Result<Frame> decodeFrame(ByteView bytes) {
    Bytes copy;
    const ByteView frame = aligned(bytes, copy);
    const wire::Frame* root = verified(frame);
    if (!root) return fail(ErrorCode::MalformedFrame, "a frame failed verification");
    try {
        return FrameDecoder(frame.size()).decode(*root);
    } catch (const Undecodable& stopped) {
        return tl::unexpected(stopped.error);
    }
}

Result<std::optional<Bytes>> importStub(ByteView encodedCommit, const Hash& hash) {
    Bytes copy;
    const wire::Frame* root = verified(aligned(encodedCommit, copy));
    const wire::Commit* commit = root ? root->body_as_Commit() : nullptr;
    if (!commit || commit->previous()->size() != sizeof(Hash))
        return fail(ErrorCode::MalformedFrame, "a stored commit failed verification");
    if (!commit->imported()) return std::nullopt;
    CommitFrame stub;
    stub.commit.revision = commit->revision();
    stub.commit.epoch = commit->epoch();
    stub.commit.id = {{commit->client()->str()}, commit->sequence()};
    stub.commit.user = {commit->user()->str()};
    stub.commit.timeMs = commit->time_ms();
    stub.commit.imported = LayerId{commit->imported()->str()};
    std::copy(commit->previous()->begin(), commit->previous()->end(),
              stub.commit.previous.bytes.begin());
    stub.hashAfter = hash;
    return encodeFrame(stub);
}

Result<void> forEachBlob(ByteView encodedCommit, const std::function<void(const Hash&)>& visit) {
    Bytes copy;
    const wire::Frame* root = verified(aligned(encodedCommit, copy));
    const wire::Commit* commit = root ? root->body_as_Commit() : nullptr;
    if (!commit) return fail(ErrorCode::MalformedFrame, "a stored commit failed verification");
    const auto look = [&](const wire::Edit& edit) {
        return forEachContent(edit, [&](const FieldValue& content) {
            forEachBlob(content, [&](const Value& blob) { visit(blob.hash()); });
        });
    };
    if (commit->edits())
        for (const wire::Edit* edit : *commit->edits())
            if (auto looked = look(*edit); !looked) return looked;
    if (commit->dropped())
        for (const wire::Dropped* dropped : *commit->dropped())
            if (auto looked = look(*dropped->edit()); !looked) return looked;
    return {};
}

}  // namespace usdlive
