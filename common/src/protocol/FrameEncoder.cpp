// Frames to bytes.
#include <sys/mman.h>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <unordered_map>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"
#include "usdlive/common/protocol/frames_generated.h"

namespace usdlive {

namespace {

template <class T>
using Offset = flatbuffers::Offset<T>;
using TextOffset = Offset<flatbuffers::String>;
using Vector = Offset<flatbuffers::Vector<std::uint8_t>>;
using EditVector = Offset<flatbuffers::Vector<Offset<wire::Edit>>>;
using DroppedVector = Offset<flatbuffers::Vector<Offset<wire::Dropped>>>;

/// Memory in which only written pages count. The buffer is as large as the largest frame and never
/// grows: growing would keep the content twice.
class PagedMemory final : public flatbuffers::Allocator {
public:
    std::uint8_t* allocate(std::size_t size) override {
        constexpr int kFlags = MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE;
        void* memory = mmap(nullptr, size, PROT_READ | PROT_WRITE, kFlags, -1, 0);
        if (memory == MAP_FAILED) throw std::bad_alloc();
        return static_cast<std::uint8_t*>(memory);
    }
    void deallocate(std::uint8_t* memory, std::size_t size) override { munmap(memory, size); }

    /// Releases the whole pages between two addresses.
    static void release(const std::uint8_t* begin, const std::uint8_t* end) {
        constexpr std::uintptr_t kPage = 4096;
        const auto first = (reinterpret_cast<std::uintptr_t>(begin) + kPage - 1) / kPage * kPage;
        const auto last = reinterpret_cast<std::uintptr_t>(end) / kPage * kPage;
        if (first < last) madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
    }
};

/// Writes one frame. A text up to kSharedTextBytes is written once, however often it occurs. Longer
/// texts are repeated, so that a decoder can limit its memory by the size of the frame (FR7).
class FrameEncoder {
public:
    FrameEncoder() : builder_(1024) {}
    FrameEncoder(PagedMemory& memory, std::size_t bytes)
        : builder_(bytes, &memory, false), isPaged_(true) {}

    Bytes encode(const Frame& frame) {
        std::visit([this](const auto& content) { finish(write(content)); }, frame);
        return take();
    }

    std::optional<ImportFrame> encode(const LayerId& layer, const LayerDoc& doc,
                                      std::size_t maxBytes) {
        std::vector<Offset<wire::Edit>> written;
        written.reserve(3 * doc.specCount());
        LayerDoc::Walk walk(doc);
        while (const LayerDoc::SpecView* spec = walk.next()) {
            if (builder_.GetSize() + sizeof(std::uint32_t) * written.size() > maxBytes)
                return std::nullopt;
            writeSpec(layer, *spec, written);
        }
        CommitFrame frame;
        frame.commit.imported = layer;
        frame.commit.revision = frame.commit.epoch = 1;  // zeroes would not be written
        frame.commit.timeMs = 1;
        finish(write(frame.commit, frame.hashAfter, builder_.CreateVector(written),
                     dropped(frame.commit.dropped), 0, false));
        return ImportFrame{take(), written.size()};
    }

    Bytes encode(const Transaction& transaction, PartsAt& at, std::size_t bytes) {
        const auto edits = editsOfPart(transaction.edits, at, bytes);
        at.isEnd = at.edit == transaction.edits.size();
        finish(write(transaction, edits, at.part++, !at.isEnd));
        return take();
    }
    Bytes encode(const Commit& commit, PartsAt& at, std::size_t bytes) {
        const auto edits = editsOfPart(commit.edits, at, bytes);
        std::vector<Offset<wire::Dropped>> dropped;
        if (at.edit == commit.edits.size())
            for (; at.dropped < commit.dropped.size(); ++at.dropped) {
                const DroppedEdit& one = commit.dropped[at.dropped];
                if (builder_.GetSize() != 0 &&
                    builder_.GetSize() + leastFrameBytes(one.edit) > bytes)
                    break;
                dropped.push_back(write(one));
            }
        at.isEnd = at.edit == commit.edits.size() && at.dropped == commit.dropped.size();
        finish(write(commit, std::nullopt, edits, builder_.CreateVector(dropped), at.part++,
                     !at.isEnd));
        return take();
    }

private:
    static constexpr std::size_t kSharedTextBytes = 128;
    // A decoder accepts a frame of these, however often they name the same long texts (FR7).
    static constexpr std::size_t kPartEdits = 20'000;

    [[nodiscard]] Bytes take() const {
        Bytes bytes;
        bytes.reserve(sizeof(std::uint32_t) + builder_.GetSize());
        appendLength(bytes);
        constexpr std::size_t kStep = 16 << 20;
        const std::uint8_t* from = builder_.GetBufferPointer();
        for (std::size_t left = builder_.GetSize(); left > 0;) {
            const std::size_t step = std::min(left, kStep);
            bytes.insert(bytes.end(), from, from + step);
            if (isPaged_) PagedMemory::release(from, from + step);
            from += step;
            left -= step;
        }
        return bytes;
    }

    template <class T>
    void finish(Offset<T> body) {
        const auto type = wire::BodyTraits<T>::enum_value;
        wire::FinishFrameBuffer(builder_, wire::CreateFrame(builder_, type, body.Union()));
    }
    void appendLength(Bytes& bytes) const {
        const std::uint32_t length = builder_.GetSize();
        for (int shift = 0; shift < 32; shift += 8) bytes.push_back(std::uint8_t(length >> shift));
    }

    TextOffset text(std::string_view value) {
        if (value.size() > kSharedTextBytes) return builder_.CreateString(value);
        const auto [entry, added] = texts_.try_emplace(std::string(value));
        if (added) entry->second = builder_.CreateString(value);
        return entry->second;
    }
    /// Most paths are new, or equal to that of the edit before.
    TextOffset path(const std::string& value) {
        if (lastPath_ && *lastPath_ == value && value.size() <= kSharedTextBytes)
            return lastPathText_;
        lastPath_ = &value;
        return lastPathText_ = builder_.CreateString(value);
    }
    Vector bytes(ByteView value) { return builder_.CreateVector(value.data(), value.size()); }
    Vector content(const FieldValue& value) {
        scratch_.clear();
        encodeFieldValue(value, scratch_);
        return bytes(scratch_);
    }
    Vector content(const Value& value) { return content(FieldValue(value)); }

    std::uint32_t layerIndex(const LayerId& layer) {
        const auto [entry, added] = layerIndices_.try_emplace(layer, std::uint32_t(layers_.size()));
        if (added) layers_.push_back(builder_.CreateString(layer.value));
        return entry->second;
    }

    std::pair<wire::Part, Offset<void>> part(const FieldPart& part) {
        using Pair = std::pair<wire::Part, Offset<void>>;
        return std::visit(
            Overloaded{
                [&](const std::monostate&) { return Pair(wire::Part::NONE, 0); },
                [&](const DictionaryKey& key) {
                    std::vector<TextOffset> keys;
                    for (const std::string& name : key.path) keys.push_back(text(name));
                    const auto path = builder_.CreateVector(keys);
                    return Pair(wire::Part::DictionaryKey,
                                wire::CreateDictionaryKey(builder_, path).Union());
                },
                [&](const SampleTime& sample) {
                    return Pair(wire::Part::SampleTime,
                                wire::CreateSampleTime(builder_, sample.time).Union());
                },
                [&](const ListItem& item) {
                    const Vector value = content(item.item);
                    const Vector before = item.before ? content(*item.before) : Vector();
                    const auto list = std::uint8_t(item.list);
                    return Pair(wire::Part::ListItem,
                                wire::CreateListItem(builder_, list, value, before).Union());
                },
                [&](const MapKey& key) {
                    return Pair(wire::Part::MapKey,
                                wire::CreateMapKey(builder_, content(key.key)).Union());
                },
            },
            part);
    }

    Offset<wire::Address> address(const Address& address) {
        const Creation creation = address.creation.value_or(Creation{});
        return wire::CreateAddress(builder_, path(address.path), creation.sequence, creation.edit);
    }

    std::pair<wire::Action, Offset<void>> action(const EditAction& action) {
        using Pair = std::pair<wire::Action, Offset<void>>;
        return std::visit(
            Overloaded{
                [&](const CreateSpec& create) {
                    const auto kind = std::uint8_t(create.kind);
                    return Pair(wire::Action::CreateSpec,
                                wire::CreateCreateSpec(builder_, kind).Union());
                },
                [&](const DeleteSpec& erased) {
                    return Pair(wire::Action::DeleteSpec,
                                wire::CreateDeleteSpec(builder_, erased.place).Union());
                },
                [&](const MoveSpec& move) {
                    const auto parent = address(move.parent);
                    const TextOffset name = text(move.name);
                    return Pair(wire::Action::MoveSpec,
                                wire::CreateMoveSpec(builder_, parent, name, move.place).Union());
                },
                [&](const PlaceSpec& place) {
                    const TextOffset before =
                        place.before.empty() ? TextOffset() : text(place.before);
                    return Pair(wire::Action::PlaceSpec,
                                wire::CreatePlaceSpec(builder_, before).Union());
                },
                [&](const SetField& set) {
                    const TextOffset field = text(set.field);
                    const auto [type, part] = this->part(set.part);
                    const bool valued = !std::holds_alternative<ListItem>(set.part);
                    const Vector value = valued ? content(set.value) : Vector();
                    const auto form = std::uint16_t(set.form);
                    return Pair(
                        wire::Action::SetField,
                        wire::CreateSetField(builder_, field, type, part, value, form).Union());
                },
                [&](const EraseField& erase) {
                    const TextOffset field = text(erase.field);
                    const auto [type, part] = this->part(erase.part);
                    return Pair(wire::Action::EraseField,
                                wire::CreateEraseField(builder_, field, type, part).Union());
                },
            },
            action);
    }

    Offset<wire::Edit> edit(const Edit& edit) {
        const std::uint32_t layer = layerIndex(edit.layer);
        // FR7: an edit has at least 32 bytes. An edit without a value has them with its own path.
        if (!std::holds_alternative<SetField>(edit.action)) lastPath_ = nullptr;
        const TextOffset path = this->path(edit.address.path);
        const Creation creation = edit.address.creation.value_or(Creation{});
        const auto [type, action] = this->action(edit.action);
        Offset<flatbuffers::Vector<Offset<wire::Address>>> names;
        if (!edit.names.empty()) {
            std::vector<Offset<wire::Address>> written;
            for (const Address& name : edit.names) written.push_back(address(name));
            names = builder_.CreateVector(written);
        }
        return wire::CreateEdit(builder_, layer, path, creation.sequence, creation.edit, type,
                                action, names);
    }
    /// Adds the edits that create a spec with its fields.
    void writeSpec(const LayerId& layer, const LayerDoc::SpecView& spec,
                   std::vector<Offset<wire::Edit>>& out) {
        const std::uint32_t index = layerIndex(layer);
        const bool shared = spec.path.size() <= kSharedTextBytes;
        TextOffset path;
        const auto add = [&](wire::Action type, Offset<void> action) {
            if (!shared || path.IsNull()) path = builder_.CreateString(spec.path);
            out.push_back(wire::CreateEdit(builder_, index, path, 0, 0, type, action));
        };
        if (spec.kind != SpecKind::PseudoRoot)
            add(wire::Action::CreateSpec,
                wire::CreateCreateSpec(builder_, std::uint8_t(spec.kind)).Union());
        for (const auto& [name, value] : *spec.fields) {
            const TextOffset field = text(name);
            const Vector bytes = content(value);
            add(wire::Action::SetField,
                wire::CreateSetField(builder_, field, wire::Part::NONE, 0, bytes).Union());
        }
    }
    EditVector edits(const std::vector<Edit>& edits) {
        std::vector<Offset<wire::Edit>> written;
        written.reserve(edits.size());
        for (const Edit& one : edits) written.push_back(edit(one));
        return builder_.CreateVector(written);
    }
    /// The edits from `at` on that fit into one part, at least one.
    EditVector editsOfPart(const std::vector<Edit>& edits, PartsAt& at, std::size_t bytes) {
        std::vector<Offset<wire::Edit>> written;
        for (; at.edit < edits.size(); ++at.edit) {
            const std::size_t size = builder_.GetSize() + sizeof(std::uint32_t) * written.size();
            if (!written.empty() && size + leastFrameBytes(edits[at.edit]) > bytes) break;
            if (written.size() == kPartEdits) break;
            written.push_back(edit(edits[at.edit]));
        }
        return builder_.CreateVector(written);
    }
    Offset<wire::Dropped> write(const DroppedEdit& one) {
        const auto edit = this->edit(one.edit);
        const TextOffset reason = text(errorName(one.reason));
        return wire::CreateDropped(builder_, one.index, reason, edit);
    }
    DroppedVector dropped(const std::vector<DroppedEdit>& dropped) {
        std::vector<Offset<wire::Dropped>> written;
        for (const DroppedEdit& one : dropped) written.push_back(write(one));
        return builder_.CreateVector(written);
    }

    Offset<wire::Control> write(const ControlFrame& frame) {
        return wire::CreateControl(builder_, builder_.CreateString(frame.json));
    }
    TextOffset labelOfPart(const std::string& label, std::uint32_t part) {
        return label.empty() || part != 0 ? TextOffset() : text(label);
    }
    Offset<wire::Submit> write(const SubmitFrame& frame) {
        return write(frame.transaction, edits(frame.transaction.edits), frame.part, frame.more);
    }
    Offset<wire::Submit> write(const Transaction& transaction, EditVector edits, std::uint32_t part,
                               bool more) {
        const auto layers = builder_.CreateVector(layers_);
        const TextOffset client = text(transaction.id.client.value);
        const TextOffset label = labelOfPart(transaction.label, part);
        return wire::CreateSubmit(builder_, client, transaction.id.sequence, transaction.base,
                                  transaction.gesture, layers, edits, part, more, transaction.seen,
                                  label);
    }
    Offset<wire::Commit> write(const CommitFrame& frame) {
        const EditVector edits = this->edits(frame.commit.edits);
        return write(frame.commit, frame.hashAfter, edits, dropped(frame.commit.dropped),
                     frame.part, frame.more);
    }
    Offset<wire::Commit> write(const Commit& commit, const std::optional<Hash>& after,
                               EditVector edits, DroppedVector dropped, std::uint32_t part,
                               bool more) {
        const auto layers = builder_.CreateVector(layers_);
        const TextOffset client = text(commit.id.client.value);
        const TextOffset user = text(commit.user.value);
        const TextOffset imported = commit.imported ? text(commit.imported->value) : TextOffset();
        const Vector previous = bytes(commit.previous.bytes);
        const Vector hashAfter = after ? bytes(after->bytes) : Vector();
        const TextOffset label = labelOfPart(commit.label, part);
        return wire::CreateCommit(builder_, commit.revision, commit.epoch, client,
                                  commit.id.sequence, user, commit.timeMs, commit.gesture, imported,
                                  layers, edits, dropped, previous, hashAfter, commit.conflated,
                                  part, more, commit.firstUnseen, label);
    }
    Offset<wire::Refusal> write(const RefusalFrame& frame) {
        const TextOffset code = text(errorName(frame.error.code));
        const TextOffset message = text(frame.error.message);
        return wire::CreateRefusal(builder_, frame.sequence, frame.edit, code, message);
    }
    Offset<wire::Preview> write(const PreviewFrame& frame) {
        const auto edits = this->edits(frame.edits);
        const auto layers = builder_.CreateVector(layers_);
        const TextOffset author = text(frame.author.value);
        return wire::CreatePreview(builder_, author, frame.gesture, frame.base, layers, edits);
    }
    Offset<wire::Snapshot> write(const SnapshotFrame& frame) {
        return wire::CreateSnapshot(builder_, frame.request, frame.index, frame.last,
                                    frame.rawBytes, bytes(frame.data));
    }
    Offset<wire::Blob> write(const BlobFrame& frame) {
        const Vector hash = bytes(frame.hash.bytes);
        return wire::CreateBlob(builder_, hash, frame.size, frame.offset, frame.rawBytes,
                                bytes(frame.data), frame.gesture);
    }

    flatbuffers::FlatBufferBuilder builder_;
    bool isPaged_ = false;
    std::unordered_map<std::string, TextOffset> texts_;
    std::unordered_map<LayerId, std::uint32_t> layerIndices_;
    std::vector<TextOffset> layers_;
    const std::string* lastPath_ = nullptr;
    TextOffset lastPathText_;
    Bytes scratch_;
};

}  // namespace

Bytes encodeFrame(const Frame& frame) { return FrameEncoder().encode(frame); }

Bytes encodePart(const Transaction& transaction, PartsAt& at, std::size_t bytes) {
    return FrameEncoder().encode(transaction, at, bytes);
}
Bytes encodePart(const Commit& commit, PartsAt& at, std::size_t bytes) {
    return FrameEncoder().encode(commit, at, bytes);
}

std::optional<ImportFrame> encodeImport(const LayerId& layer, const LayerDoc& doc,
                                        std::size_t maxBytes) {
    PagedMemory memory;
    return FrameEncoder(memory, maxBytes).encode(layer, doc, maxBytes);
}

void stampCommit(Bytes& frame, const Commit& place) {
    auto* root = flatbuffers::GetMutableRoot<wire::Frame>(frame.data() + sizeof(std::uint32_t));
    auto* commit = const_cast<wire::Commit*>(root->body_as_Commit());
    auto* table = reinterpret_cast<flatbuffers::Table*>(commit);
    bool done = table->SetField<std::uint64_t>(wire::Commit::VT_REVISION, place.revision, 0);
    done &= table->SetField<std::uint64_t>(wire::Commit::VT_EPOCH, place.epoch, 0);
    done &= table->SetField<std::int64_t>(wire::Commit::VT_TIME_MS, place.timeMs, 0);
    if (!done) throw std::logic_error("a commit's frame was not made to be stamped");
    auto* previous = const_cast<flatbuffers::Vector<std::uint8_t>*>(commit->previous());
    std::ranges::copy(place.previous.bytes, previous->data());
}

}  // namespace usdlive
