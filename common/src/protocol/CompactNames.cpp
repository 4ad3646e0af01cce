// The numbers of names (FR10).
#include <functional>

#include "CompactBytes.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive {

namespace {

constexpr std::size_t kSeenOnce = 4096;     // names that are remembered before they get a number
constexpr std::size_t kLeastNameBytes = 3;  // a shorter one is not longer than its number
constexpr std::size_t kRenumberAfter = 4 * kMaxNames;  // names without a number

}  // namespace

NameNumbers::NameNumbers() : seen_(kSeenOnce) {}

void NameNumbers::beginFrame() {
    ++frame_;
    used_.clear();
    if (unnumbered_ < kRenumberAfter) return;
    unnumbered_ = 0;
    numbers_.clear();
    names_.clear();
    ++numbering_;
}

std::optional<std::uint32_t> NameNumbers::numberOf(std::string_view name) {
    if (name.size() < kLeastNameBytes || name.size() > kMaxNameBytes) return std::nullopt;
    auto found = numbers_.find(name);
    if (found == numbers_.end()) {
        const std::size_t hash = std::hash<std::string_view>()(name);
        std::size_t& seen = seen_[hash % seen_.size()];
        if (seen != hash) {
            seen = hash;
            return std::nullopt;
        }
        if (names_.size() == kMaxNames) {
            ++unnumbered_;
            return std::nullopt;
        }
        names_.push_back({std::make_shared<const std::string>(name)});
        found = numbers_.emplace(*names_.back().text, std::uint32_t(names_.size() - 1)).first;
    }
    Entry& entry = names_[found->second];
    if (entry.usedBy != frame_) {
        entry.usedBy = frame_;
        used_.push_back(found->second);
    }
    return found->second;
}

void NameNumbers::endFrame(CompactFrame& frame) {
    frame.numbering = numbering_;
    frame.names.reserve(used_.size());
    for (const std::uint32_t number : used_) frame.names.push_back({number, names_[number].text});
}

SharedBytes KnownNames::introduce(const CompactFrame& frame) {
    if (numbering_ != frame.numbering) {
        numbering_ = frame.numbering;
        known_.reset();
    }
    std::vector<const NumberedName*> unknown;
    for (const NumberedName& name : frame.names)
        if (!known_[name.number]) unknown.push_back(&name);
    if (unknown.empty()) return nullptr;
    compact::BytesOut out(compact::Kind::Names);
    out.varint(unknown.size());
    for (const NumberedName* name : unknown) {
        known_.set(name->number);
        out.varint(name->number);
        out.varint(name->text->size());
        out.bytes(asBytes(*name->text));
    }
    return std::make_shared<const Bytes>(out.finish());
}

}  // namespace usdlive
