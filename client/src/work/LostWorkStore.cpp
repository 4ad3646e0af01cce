// Keeps the lost edits of a client in memory and in a file.
#include "work/LostWorkStore.h"

#include <algorithm>
#include <system_error>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

constexpr const char* kFileName = "lost-work";

}  // namespace

Bytes encodeAuthored(std::uint64_t sequence, const std::vector<AuthoredEdit>& edits) {
    Transaction transaction;
    transaction.id = {ClientId{"kept"}, std::max<std::uint64_t>(sequence, 1)};
    for (const AuthoredEdit& edit : edits)
        transaction.edits.push_back({edit.layer, {edit.path, {}}, edit.action});
    Bytes bytes;
    for (PartsAt at; !at.isEnd;) appendBytes(bytes, encodePart(transaction, at));  // FR8
    return bytes;
}

Result<std::vector<AuthoredEdit>> decodeAuthored(ByteView bytes) {
    const auto frames = splitMessage(bytes, ~std::uint32_t(0));
    if (!frames) return tl::unexpected(frames.error());
    SubmitParts parts;
    std::optional<Transaction> whole;
    for (const ByteView encoded : *frames) {
        auto frame = decodeFrame(encoded);
        if (!frame) return tl::unexpected(frame.error());
        auto* submit = std::get_if<SubmitFrame>(&*frame);
        if (!submit || whole)
            return fail(ErrorCode::MalformedFrame, "the stored edits are not a transaction");
        auto joined = parts.add(std::move(*submit));
        if (!joined) return tl::unexpected(joined.error());
        whole = std::move(*joined);
    }
    if (!whole) return fail(ErrorCode::MalformedFrame, "the stored edits end too early");
    std::vector<AuthoredEdit> edits;
    for (Edit& edit : whole->edits)
        edits.push_back(
            {std::move(edit.layer), std::move(edit.address.path), std::move(edit.action)});
    return edits;
}

Bytes encodeLostWork(const LostWork& work) {
    Bytes bytes;
    appendNumber<std::uint64_t>(bytes, work.sequence);
    appendNumber<std::uint64_t>(bytes, work.gesture);
    appendNumber<std::uint8_t>(bytes, work.refused ? 1 : 0);
    appendText(bytes, errorName(work.reason.code));
    appendText(bytes, work.reason.message);
    appendBytes(bytes, encodeAuthored(work.sequence, work.edits));
    return bytes;
}

Result<LostWork> decodeLostWork(ByteView bytes) {
    ByteReader reader(bytes);
    LostWork work;
    work.sequence = reader.u64();
    work.gesture = reader.u64();
    work.refused = reader.u8() != 0;
    work.reason.code = errorFromName(reader.text()).value_or(ErrorCode::Internal);
    work.reason.message = reader.text();
    auto edits = decodeAuthored(reader.take(reader.left()));
    if (!edits) return tl::unexpected(edits.error());
    work.edits = std::move(*edits);
    return work;
}

LostWorkStore::LostWorkStore(fs::path folder, std::size_t inMemory)
    : folder_(std::move(folder)), inMemory_(inMemory) {}

LostWorkStore::~LostWorkStore() {
    file_.remove();
    std::error_code ignored;
    fs::remove(folder_, ignored);  // fails, as intended, if it contains a layer's content
}

Result<void> LostWorkStore::add(LostWork work) {
    newest_.push_back(std::move(work));
    return newest_.size() > inMemory_ ? spill() : Result<void>();
}

// Moves half of the entries at once, so that not each new entry writes to the file.
Result<void> LostWorkStore::spill() {
    if (!file_.isOpen()) {
        std::error_code ignored;
        fs::create_directories(folder_, ignored);
        for (unsigned number = 0; !file_.isOpen(); ++number) {
            const fs::path path = folder_ / (kFileName + std::to_string(number));
            auto opened = RecordFile::open(path, RecordFile::Mode::New);
            if (opened)
                file_ = std::move(*opened);
            else if (!fs::exists(path, ignored))
                return tl::unexpected(opened.error());
        }
    }
    const std::size_t count = newest_.size() - inMemory_ / 2;
    std::vector<Bytes> records;
    for (std::size_t index = 0; index < count; ++index)
        records.push_back(encodeLostWork(newest_[index]));
    const auto places = file_.append(records);
    if (!places) return tl::unexpected(places.error());
    places_.insert(places_.end(), places->begin(), places->end());
    newest_.erase(newest_.begin(), newest_.begin() + std::ptrdiff_t(count));
    return {};
}

Result<LostWork> LostWorkStore::at(std::uint64_t index) const {
    if (index >= size())
        return fail(ErrorCode::InvalidArgument, "there is no lost work number " +
                                                    std::to_string(index) + "; there are " +
                                                    std::to_string(size()));
    if (index >= places_.size()) return newest_[std::size_t(index) - places_.size()];
    const auto bytes = file_.read(places_[std::size_t(index)]);
    if (!bytes) return tl::unexpected(bytes.error());
    return decodeLostWork(*bytes);
}

fs::path LostWorkStore::fileFor(const LayerId& layer) {
    std::error_code ignored;
    fs::create_directories(folder_, ignored);
    std::string name = fs::path(layer.value).filename().string();
    fs::path path;
    do path = folder_ / (std::to_string(++files_) + "-" + name);
    while (fs::exists(path, ignored));
    return path;
}

}  // namespace usdlive::client
