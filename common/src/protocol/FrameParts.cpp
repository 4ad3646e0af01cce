// Transactions and commits in parts (FR8).
#include "usdlive/common/protocol/FrameParts.h"

#include <iterator>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

struct Content {
    std::uint64_t operator()(const Value& value) const {
        return value.isBlob() ? sizeof(Hash) : value.bytes().size();
    }
    std::uint64_t operator()(const Dictionary& value) const {
        std::uint64_t bytes = 0;
        for (const auto& [key, entry] : value.entries)
            bytes += key.size() + std::visit(*this, entry);
        return bytes;
    }
    std::uint64_t operator()(const TimeSamples& value) const {
        std::uint64_t bytes = 0;
        for (const auto& [time, sample] : value.samples) bytes += sizeof time + (*this)(sample);
        return bytes;
    }
    std::uint64_t operator()(const ListOp& value) const {
        std::uint64_t bytes = 0;
        for (const auto& list : value.lists)
            for (const Value& item : list) bytes += (*this)(item);
        return bytes;
    }
    std::uint64_t operator()(const Map& value) const {
        std::uint64_t bytes = 0;
        for (const auto& [key, entry] : value.entries) bytes += (*this)(key) + (*this)(entry);
        return bytes;
    }
};

template <class T>
void append(std::vector<T>& all, std::vector<T>&& more) {
    if (all.empty())
        all = std::move(more);
    else
        all.insert(all.end(), std::make_move_iterator(more.begin()),
                   std::make_move_iterator(more.end()));
}

tl::unexpected<Error> outOfPlace(std::uint32_t part) {
    return fail(ErrorCode::MalformedFrame,
                "part " + std::to_string(part) + " does not follow the part before it");
}

}  // namespace

std::uint64_t leastFrameBytes(const Edit& edit) {
    std::uint64_t bytes = edit.address.path.size();
    const auto* set = std::get_if<SetField>(&edit.action);
    if (!set) return bytes;
    bytes += set->value.visit(Content{});
    if (const auto* item = std::get_if<ListItem>(&set->part)) bytes += Content{}(item->item);
    return bytes;
}

std::uint64_t leastFrameBytes(const std::vector<Edit>& edits) {
    constexpr std::uint64_t kEditBytes = 32;  // FR7
    std::uint64_t bytes = kEditBytes * edits.size();
    const std::string* last = nullptr;  // a repeated path is written once
    for (const Edit& edit : edits) {
        bytes += leastFrameBytes(edit);
        if (last && *last == edit.address.path) bytes -= last->size();
        last = &edit.address.path;
    }
    return bytes;
}

Result<std::optional<Transaction>> SubmitParts::add(SubmitFrame part) {
    Transaction& one = part.transaction;
    if (part.part != next_ || (next_ != 0 && (one.id != whole_.id || one.base != whole_.base ||
                                              one.gesture != whole_.gesture)))
        return outOfPlace(part.part);
    if (next_++ == 0)
        whole_ = std::move(one);
    else
        append(whole_.edits, std::move(one.edits));
    if (part.more) return std::optional<Transaction>();
    return std::optional(std::move(whole_));
}

Result<std::optional<JoinedCommit>> CommitParts::add(CommitFrame part, ByteView encoded) {
    Commit& one = part.commit;
    if (part.part != next_ ||
        (next_ != 0 && (one.revision != whole_.revision || one.id != whole_.id ||
                        one.epoch != whole_.epoch || one.previous != whole_.previous)))
        return outOfPlace(part.part);
    if (next_++ == 0) {
        hash_.add(one.previous.bytes);
        whole_ = std::move(one);
    } else {
        Bytes length;
        appendNumber<std::uint32_t>(length, std::uint32_t(encoded.size()));
        hash_.add(length);
        append(whole_.edits, std::move(one.edits));
        append(whole_.dropped, std::move(one.dropped));
    }
    hash_.add(encoded);
    if (part.more) return std::optional<JoinedCommit>();
    return std::optional(JoinedCommit{std::move(whole_), hash_.finish()});
}

}  // namespace usdlive
