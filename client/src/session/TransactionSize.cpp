#include "TransactionSize.h"

namespace usdlive::client {

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

}  // namespace

std::uint64_t leastFrameBytes(const Transaction& transaction) {
    std::uint64_t bytes = 0;
    for (const Edit& edit : transaction.edits) {
        bytes += edit.address.path.size();
        const auto* set = std::get_if<SetField>(&edit.action);
        if (!set) continue;
        bytes += set->value.visit(Content{});
        if (const auto* item = std::get_if<ListItem>(&set->part)) bytes += Content{}(item->item);
    }
    return bytes;
}

}  // namespace usdlive::client
