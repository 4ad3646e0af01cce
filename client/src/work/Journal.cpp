// Writes pending transactions to the disk, and reads the journals of ended connections.
#include "work/Journal.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <system_error>

#include "basics/Clocks.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/Thread.h"
#include "work/LostWorkStore.h"

namespace usdlive::client {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

namespace {

// A transaction that is acknowledged within this time is never written.
constexpr auto kDelay = milliseconds(250);
// Retries to write the journal after this time.
constexpr auto kRetry = milliseconds(1'000);
// A larger file is written again when less than half of it is still pending.
constexpr std::uint64_t kCompactBytes = 16 * 1024 * 1024;
constexpr const char* kExtension = ".journal";
constexpr const char* kBlobExtension = ".blobs";
constexpr const char* kDamagedExtension = ".damaged";
// The first byte of a record. Earlier versions wrote transactions without the store's identity.
constexpr std::uint8_t kWorkWithoutStore = 1, kAnswered = 2, kWork = 3, kSecret = 4;

Hash takeHash(ByteReader& reader) {
    Hash hash;
    const ByteView bytes = reader.take(hash.bytes.size());
    std::copy(bytes.begin(), bytes.end(), hash.bytes.begin());
    return hash;
}

Bytes encodeWork(const JournaledWork& work) {
    Bytes bytes{kWork};
    appendNumber<std::uint64_t>(bytes, work.sequence);
    appendNumber<std::int64_t>(bytes, work.timeMs);
    appendNumber<std::uint64_t>(bytes, work.revision);
    appendBytes(bytes, work.hash.bytes);
    appendText(bytes, work.store.value);
    appendBytes(bytes, encodeAuthored(work.sequence, work.edits));
    return bytes;
}

Result<JournaledWork> decodeWork(std::uint8_t kind, ByteReader& reader) {
    JournaledWork work;
    work.sequence = reader.u64();
    work.timeMs = reader.i64();
    work.revision = reader.u64();
    work.hash = takeHash(reader);
    if (kind != kWorkWithoutStore) work.store.value = reader.text();
    auto edits = decodeAuthored(reader.take(reader.left()));
    if (!edits) return tl::unexpected(edits.error());
    work.edits = std::move(*edits);
    return work;
}

Bytes encodeSecret(const Hash& secret) {
    Bytes bytes{kSecret};
    appendBytes(bytes, secret.bytes);
    return bytes;
}

Bytes encodeAnswered(std::uint64_t sequence) {
    Bytes bytes{kAnswered};
    appendNumber<std::uint64_t>(bytes, sequence);
    return bytes;
}

// Returns a distinct folder name for each text.
std::string fileName(const std::string& text) {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string name;
    for (const char c : text) {
        const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                           (c >= '0' && c <= '9') || c == '-' || c == '_';
        if (plain) {
            name += c;
        } else {
            name += '%';
            name += kDigits[std::uint8_t(c) >> 4];
            name += kDigits[std::uint8_t(c) & 15];
        }
    }
    constexpr std::size_t kLongest = 120;
    if (name.size() > kLongest)
        name = name.substr(0, kLongest) + "-" + sha256(asBytes(text)).hex().substr(0, 16);
    return name.empty() ? "%" : name;
}

fs::path journalPath(const fs::path& folder, const ClientId& client) {
    return folder / (client.value + kExtension);
}
fs::path damagedPath(const fs::path& journal) {
    return fs::path(journal).replace_extension(kDamagedExtension);
}
fs::path blobFolderOf(const fs::path& journal) {
    return fs::path(journal).replace_extension(kBlobExtension);
}

// Returns the big values that the transaction names.
std::set<Hash> hashes(const JournaledWork& work) {
    std::set<Hash> named;
    for (const AuthoredEdit& edit : work.edits)
        forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    return named;
}

void add(UnsentWork& sum, const UnsentWork& one) {
    sum.timeMs = std::max(sum.timeMs, one.timeMs);
    sum.transactions += one.transactions;
    sum.edits += one.edits;
    for (const LayerId& layer : one.layers)
        if (std::find(sum.layers.begin(), sum.layers.end(), layer) == sum.layers.end())
            sum.layers.push_back(layer);
}

UnsentWork describe(std::int64_t timeMs, const std::vector<AuthoredEdit>& edits) {
    UnsentWork one;
    one.timeMs = timeMs;
    one.transactions = 1;
    one.edits = edits.size();
    for (const AuthoredEdit& edit : edits)
        if (std::find(one.layers.begin(), one.layers.end(), edit.layer) == one.layers.end())
            one.layers.push_back(edit.layer);
    return one;
}

Result<void> writeSynced(const fs::path& path, const Bytes& bytes) {
    auto unfinished = path;
    unfinished += ".part";
    const auto failed = [&] {
        const auto reason = std::error_code(errno, std::generic_category()).message();
        ::unlink(unfinished.c_str());
        return fail(ErrorCode::StorageFailed, "cannot write " + path.string() + ": " + reason);
    };
    const Descriptor file(
        ::open(unfinished.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NONBLOCK, 0600));
    if (!file) return failed();
    std::size_t written = 0;
    while (written < bytes.size()) {
        const ssize_t put = ::write(file.get(), bytes.data() + written, bytes.size() - written);
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) break;
        written += std::size_t(put);
    }
    const bool whole = written == bytes.size() && ::fdatasync(file.get()) == 0;
    if (!whole || ::rename(unfinished.c_str(), path.c_str()) != 0) return failed();
    return {};
}

// Removes big values without a journal, which a killed process may have left.
void removeOrphan(const fs::path& folder) {
    constexpr auto kSurelyLeft = std::chrono::hours(1);
    std::error_code error;
    if (folder.extension() != kBlobExtension ||
        fs::exists(fs::path(folder).replace_extension(kExtension), error))
        return;
    const auto written = fs::last_write_time(folder, error);
    if (!error && fs::file_time_type::clock::now() - written > kSurelyLeft)
        fs::remove_all(folder, error);
}

// A new file name is durable only after its folder was synced.
void syncFolder(const fs::path& folder) {
    const Descriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (opened) ::fsync(opened.get());
}

}  // namespace

fs::path journalFolder(const fs::path& root, const std::string& project, const UserName& user) {
    return root / fileName(project) / fileName(user.value);
}

fs::path stateFolder() {
    const auto set = [](const char* name) {
        const char* value = std::getenv(name);
        return value && *value == '/' ? fs::path(value) : fs::path();
    };
    if (const auto state = set("XDG_STATE_HOME"); !state.empty()) return state / "usdlive";
    if (const auto home = set("HOME"); !home.empty()) return home / ".local/state/usdlive";
    return {};
}

// ---- Journal

Journal::Journal(fs::path folder, ClientId client, std::optional<Hash> secret, BlobSource& blobs)
    : folder_(std::move(folder)),
      client_(std::move(client)),
      secret_(std::move(secret)),
      blobs_(blobs),
      thread_(startThread("usdlive journal", [this] { run(); })) {}

Journal::~Journal() {
    {
        const std::lock_guard lock(mutex_);
        stopping_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

void Journal::pending(const PendingWork& work) {
    JournaledWork kept{work.sequence, wallClockMs(), work.revision,
                       work.hash,     work.store,    work.edits};
    const std::lock_guard lock(mutex_);
    if (works_.empty() && answered_.empty())
        changed_.notify_all();  // otherwise the thread is awake
    pending_[work.sequence] = describe(kept.timeMs, kept.edits);
    works_[work.sequence] = std::move(kept);
}

void Journal::answered(std::uint64_t sequence) {
    const std::lock_guard lock(mutex_);
    if (pending_.erase(sequence) == 0) return;
    if (works_.empty() && answered_.empty()) changed_.notify_all();
    works_.erase(sequence);
    answered_.insert(sequence);
}

void Journal::flush() {
    std::unique_lock lock(mutex_);
    hurry_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] {
        return (works_.empty() && answered_.empty() && !busy_) || error_ || failing_;
    });
    hurry_ = false;
}

std::set<Hash> Journal::neededBlobs() {
    const std::lock_guard lock(mutex_);
    std::set<Hash> needed = writing_;
    for (const auto& [sequence, work] : works_) needed.merge(hashes(work));
    return needed;
}

std::optional<UnsentWork> Journal::summary() {
    const std::lock_guard lock(mutex_);
    if (pending_.empty()) return std::nullopt;
    UnsentWork sum;
    sum.client = client_;
    sum.file = journalPath(folder_, client_).string();
    for (const auto& [sequence, one] : pending_) add(sum, one);
    return sum;
}

std::optional<Error> Journal::takeError() {
    const std::lock_guard lock(mutex_);
    return std::exchange(error_, std::nullopt);
}

void Journal::run() {
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return stopping_ || !works_.empty() || !answered_.empty(); });
        const auto delay = failing_ ? kRetry : kDelay;
        if (!stopping_)
            changed_.wait_for(lock, delay, [this] { return stopping_ || (hurry_ && !failing_); });
        const bool last = stopping_;
        auto works = std::exchange(works_, {});
        auto answered = std::exchange(answered_, {});
        busy_ = true;
        for (const auto& [sequence, work] : works) writing_.merge(hashes(work));
        lock.unlock();
        write(works, answered);
        lock.lock();
        busy_ = false;
        writing_.clear();
        // Transactions that could not be written are written later, unless they were answered.
        for (auto& [sequence, work] : works)
            if (pending_.contains(sequence)) works_.try_emplace(sequence, std::move(work));
        for (const std::uint64_t sequence : answered) answered_.insert(sequence);
        changed_.notify_all();
        if (last) return;
    }
}

// Leaves entries that could not be written in both arguments.
void Journal::write(std::map<std::uint64_t, JournaledWork>& works,
                    std::set<std::uint64_t>& answered) {
    std::erase_if(answered, [&](std::uint64_t sequence) { return !places_.contains(sequence); });
    const auto written = writeBatch(works, answered);
    if (!written) removeUnnamed();
    const std::lock_guard lock(mutex_);
    if (written) {
        failing_ = false;
        works.clear();
        answered.clear();
    } else if (!std::exchange(failing_, true)) {
        error_ = {written.error().code,
                  "unsent work is not kept on the disk: " + written.error().message +
                      ". It is tried again every second"};
    }
}

Result<void> Journal::writeBatch(const std::map<std::uint64_t, JournaledWork>& works,
                                 const std::set<std::uint64_t>& answered) {
    if (works.empty() && places_.size() == answered.size()) {
        removeAll();
        return {};
    }
    if (!file_.isOpen())
        if (const auto opened = openFile(); !opened) return opened;
    std::vector<Bytes> records;
    for (const auto& [sequence, work] : works) {
        if (const auto kept = keepBlobs(work); !kept) return kept;
        records.push_back(encodeWork(work));
    }
    for (const std::uint64_t sequence : answered) records.push_back(encodeAnswered(sequence));
    const auto places = file_.append(records);
    if (!places) return tl::unexpected(places.error());
    std::size_t index = 0;
    for (const auto& [sequence, work] : works) {
        places_[sequence] = {(*places)[index], records[index].size()};
        ++index;
    }
    for (const std::uint64_t sequence : answered) places_.erase(sequence);
    std::uint64_t live = 0;
    for (const auto& [sequence, place] : places_) live += place.bytes;
    const bool compacts = file_.size() > kCompactBytes && live < file_.size() / 2;
    if (const auto done = compacts ? compact() : file_.sync(); !done) return done;
    // A changed transaction, such as that of an open gesture, may name other values than before.
    for (const auto& [sequence, work] : works) name(sequence, hashes(work));
    for (const std::uint64_t sequence : answered) name(sequence, {});
    return {};
}

Result<void> Journal::openFile() {
    std::error_code error;
    fs::create_directories(folder_, error);
    fs::permissions(folder_, fs::perms::owner_all, error);
    auto opened = RecordFile::open(journalPath(folder_, client_), RecordFile::Mode::New);
    if (!opened) return tl::unexpected(opened.error());
    file_ = std::move(*opened);
    if (secret_)
        if (const auto written = file_.append({encodeSecret(*secret_)}); !written) {
            file_.remove();
            return tl::unexpected(written.error());
        }
    syncFolder(folder_);
    return {};
}

// Writes big values as separate files, by their hash, because the cache may drop them.
Result<void> Journal::keepBlobs(const JournaledWork& work) {
    std::set<Hash> missing = hashes(work);
    std::erase_if(missing, [this](const Hash& hash) { return kept_.contains(hash); });
    if (missing.empty()) return {};
    const fs::path folder = blobFolderOf(journalPath(folder_, client_));
    std::error_code error;
    fs::create_directories(folder, error);
    for (const Hash& hash : missing) {
        const auto bytes = blobs_.blob(hash);
        if (!bytes) continue;  // a value of another user's edit, which the server has
        if (const auto written = writeSynced(folder / hash.hex(), *bytes); !written) return written;
        kept_.insert(hash);
    }
    syncFolder(folder);
    return {};
}

// Notes that the transaction names these values and no others. Removes values that no transaction
// names.
void Journal::name(std::uint64_t sequence, std::set<Hash> named) {
    for (const Hash& hash : named) ++names_[hash];
    for (const Hash& hash : std::exchange(named_[sequence], std::move(named))) {
        if (--names_[hash] > 0) continue;
        names_.erase(hash);
        if (kept_.erase(hash) > 0) removeBlob(hash);
    }
    if (named_[sequence].empty()) named_.erase(sequence);
}

// Removes values of transactions that could not be written, because they may name others at the
// next attempt.
void Journal::removeUnnamed() {
    std::erase_if(kept_, [this](const Hash& hash) {
        if (names_.contains(hash)) return false;
        removeBlob(hash);
        return true;
    });
}

void Journal::removeBlob(const Hash& hash) {
    std::error_code ignored;
    fs::remove(blobFolderOf(journalPath(folder_, client_)) / hash.hex(), ignored);
}

Result<void> Journal::compact() {
    const fs::path path = journalPath(folder_, client_);
    auto unfinished = path;
    unfinished += ".part";
    std::error_code ignored;
    fs::remove(unfinished, ignored);
    auto fresh = RecordFile::open(unfinished, RecordFile::Mode::New);
    if (!fresh) return tl::unexpected(fresh.error());
    if (secret_)
        if (const auto written = fresh->append({encodeSecret(*secret_)}); !written)
            return tl::unexpected(written.error());
    std::map<std::uint64_t, Place> places;
    for (const auto& [sequence, place] : places_) {
        auto record = file_.read(place.at);
        if (!record) return tl::unexpected(record.error());
        const std::uint64_t bytes = record->size();
        const auto at = fresh->append({std::move(*record)});
        if (!at) return tl::unexpected(at.error());
        places[sequence] = {at->front(), bytes};
    }
    if (const auto synced = fresh->sync(); !synced) return synced;
    if (const auto moved = fresh->moveTo(path); !moved) return moved;
    syncFolder(folder_);
    file_ = std::move(*fresh);
    places_ = std::move(places);
    return {};
}

void Journal::removeAll() {
    places_.clear();
    kept_.clear();
    named_.clear();
    names_.clear();
    if (!file_.isOpen()) return;
    const fs::path path = file_.path();
    file_.remove();
    std::error_code ignored;
    fs::remove_all(blobFolderOf(path), ignored);
}

// ---- LeftJournal

Result<LeftJournal> LeftJournal::open(const fs::path& folder, const ClientId& client) {
    const fs::path path = journalPath(folder, client);
    auto file = RecordFile::open(path, RecordFile::Mode::Existing);
    if (!file) return tl::unexpected(file.error());
    LeftJournal journal;
    journal.client_ = client;
    journal.file_ = std::move(*file);
    std::optional<Error> damage;
    const auto read = journal.file_.readAll([&](std::uint64_t, ByteView payload) {
        ByteReader reader(payload);
        const std::uint8_t kind = reader.u8();
        if (kind == kAnswered) {
            journal.works_.erase(reader.u64());
        } else if (kind == kSecret) {
            journal.secret_ = takeHash(reader);
        } else if (auto work = decodeWork(kind, reader)) {
            journal.works_[work->sequence] = std::move(*work);
        } else {
            damage = work.error();
        }
    });
    if (!read && read.error().code != ErrorCode::StorageCorrupt)
        return tl::unexpected(read.error());
    if (!read)
        journal.damage_ = {read.error().code,
                           read.error().message +
                               ". The unsent edits from there on cannot be sent. The file is kept "
                               "as " +
                               damagedPath(path).string()};
    if (damage)
        return fail(ErrorCode::StorageCorrupt,
                    path.string() + " cannot be read: " + damage->message);
    return journal;
}

std::vector<UnsentWork> LeftJournal::list(const fs::path& folder, const StoreId& store,
                                          std::vector<Error>& damaged) {
    std::vector<UnsentWork> all;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
        removeOrphan(entry.path());
        if (entry.path().extension() != kExtension) continue;
        auto journal = open(folder, ClientId{entry.path().stem().string()});
        if (!journal) {
            if (journal.error().code != ErrorCode::StorageLocked)
                damaged.push_back(journal.error());
            continue;
        }
        if (journal->damage_) damaged.push_back(*journal->damage_);
        if (journal->works().empty()) {
            journal->remove();
            continue;
        }
        all.push_back(journal->summary());
        all.back().otherProject = journal->isOfOther(store);
    }
    std::sort(all.begin(), all.end(),
              [](const auto& left, const auto& right) { return left.timeMs < right.timeMs; });
    return all;
}

UnsentWork LeftJournal::summary() const {
    UnsentWork sum;
    sum.client = client_;
    sum.file = file_.path().string();
    for (const auto& [sequence, work] : works_) add(sum, describe(work.timeMs, work.edits));
    return sum;
}

bool LeftJournal::isOfOther(const StoreId& store) const {
    return std::ranges::any_of(
        works_, [&](const auto& one) { return isOtherStore(one.second.store, store); });
}

fs::path LeftJournal::blobFolder() const { return blobFolderOf(file_.path()); }

Result<void> LeftJournal::answered(const std::vector<std::uint64_t>& sequences,
                                   std::optional<JournaledWork> renumbered) {
    std::vector<Bytes> records;
    if (renumbered) {
        records.push_back(encodeWork(*renumbered));
        works_[renumbered->sequence] = std::move(*renumbered);
    }
    for (const std::uint64_t sequence : sequences)
        if (works_.erase(sequence) > 0) records.push_back(encodeAnswered(sequence));
    if (records.empty()) return {};
    if (const auto written = file_.append(records); !written)
        return tl::unexpected(written.error());
    return file_.sync();
}

void LeftJournal::remove() {
    const fs::path blobs = blobFolder();
    if (damage_ && file_.moveTo(damagedPath(file_.path()))) return;
    file_.remove();
    std::error_code ignored;
    fs::remove_all(blobs, ignored);
}

}  // namespace usdlive::client
