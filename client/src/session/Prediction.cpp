// The predicted side: own transactions and previews, executed on the confirmed layers (M7).
#include "Prediction.h"

#include <algorithm>
#include <iterator>
#include <set>

namespace usdlive::client {

namespace {

// Node ids from here on are predicted: first those of previews, then a block of ids for each own
// transaction, which follows from its sequence number.
constexpr NodeId kFirstPreviewed = NodeId(1) << 62;
constexpr NodeId kFirstOwn = NodeId(1) << 63;
constexpr int kBlockBits = 24;  // kMaxTransactionEdits

NodeId ownBlock(std::uint64_t sequence) { return kFirstOwn + (sequence << kBlockBits); }

// With more structural changes than this, effect() does not search them for each committed edit.
constexpr std::size_t kStructuralSearched = 256;

// Fields whose content depends on the type of the attribute (ED9).
constexpr std::string_view kTypedFields[] = {"default", "spline", "timeSamples"};

std::string fieldKey(std::string_view path, std::string_view field) {
    return std::string(path).append(1, '\0').append(field);
}

bool writesWhole(const EditAction& action) {
    const auto whole = [](const auto* write) {
        return write && std::holds_alternative<std::monostate>(write->part);
    };
    return whole(std::get_if<SetField>(&action)) || whole(std::get_if<EraseField>(&action));
}

}  // namespace

std::string destination(std::string_view path, const MoveSpec& move) {
    return specpath::child(move.parent.path, specpath::last(path).list, move.name);
}

const std::string* fieldOf(const EditAction& action) {
    if (const auto* set = std::get_if<SetField>(&action)) return &set->field;
    if (const auto* erase = std::get_if<EraseField>(&action)) return &erase->field;
    return nullptr;
}

void collectBlobs(const EditAction& action, std::vector<Value>& blobs) {
    forEachBlob(action, [&](const Value& blob) { blobs.push_back(blob); });
}

void Prediction::Moves::add(std::string from, std::string to) {
    byTarget_.emplace(to, moves_.size());
    moves_.emplace_back(std::move(from), std::move(to));
}

std::string Prediction::Moves::undone(std::string path) const {
    for (auto last = lastTo(path, moves_.size()); last; last = lastTo(path, *last))
        path = specpath::replacePrefix(path, moves_[*last].second, moves_[*last].first);
    return path;
}

// Returns the number of the last move before `end` that moved the spec at `path` or an ancestor.
std::optional<std::size_t> Prediction::Moves::lastTo(std::string path, std::size_t end) const {
    std::optional<std::size_t> last;
    for (; path.size() > 1; path = specpath::parent(path)) {
        const auto next = byTarget_.lower_bound({path, end});
        if (next != byTarget_.begin() && std::prev(next)->first == path)
            last = std::max(last, std::optional(std::prev(next)->second));
    }
    return last;
}

std::size_t Prediction::fieldsNoted() const {
    std::size_t noted = 0;
    for (const auto& [layer, notes] : notes_) noted += notes.fields.size();
    return noted;
}

const LayerDoc* Prediction::find(const LayerId& layer) const {
    if (const auto own = docs_.find(layer); own != docs_.end()) return &own->second;
    const auto entry = confirmed_->layers.find(layer);
    return entry == confirmed_->layers.end() ? nullptr : &entry->second;
}

LayerDoc* Prediction::open(const LayerId& layer) {
    if (const auto own = docs_.find(layer); own != docs_.end()) return &own->second;
    const auto entry = confirmed_->layers.find(layer);
    if (entry == confirmed_->layers.end()) return nullptr;
    openedAt_.emplace(layer, confirmed_->revision);
    return &docs_.emplace(layer, entry->second).first->second;
}

Revision Prediction::openedAt(const LayerId& layer) const {
    const auto opened = openedAt_.find(layer);
    return opened == openedAt_.end() ? confirmed_->revision : opened->second;
}

Revision Prediction::oldest(Revision otherwise) const {
    for (const auto& [layer, revision] : openedAt_) otherwise = std::min(otherwise, revision);
    return otherwise;
}

void Prediction::preview(std::uint64_t slot, const PreviewFrame& frame) {
    Transaction transaction{.id = {frame.author, kThisPreview},
                            .base = frame.base,
                            .gesture = frame.gesture,
                            .edits = frame.edits};
    // Addresses by creations of the author's unacknowledged transactions are unknown here. Such
    // edits are dropped until the author sends them with other addresses.
    OwnCreations theirs;
    std::swap(creations_, theirs);
    const std::uint64_t mark = names_.mark();
    execute(transaction, false, kFirstPreviewed + (slot << kBlockBits), false);
    std::swap(creations_, theirs);
    previewsChangeNames_ = previewsChangeNames_ || names_.mark() != mark;
}

Prognosis Prediction::run(const Transaction& transaction) {
    return execute(transaction, true, ownBlock(transaction.id.sequence), false).prognosis;
}

Prediction::Landed Prediction::land(const Transaction& transaction) {
    return execute(transaction, true, ownBlock(transaction.id.sequence), true);
}

Prediction::Landed Prediction::execute(const Transaction& transaction, bool own, NodeId firstNode,
                                       bool wantEdits) {
    Landed landed;
    if (wantEdits) landed.edits.resize(transaction.edits.size());
    std::set<LayerId> absent;  // not joined here: their edits have no effect
    for (const Edit& edit : transaction.edits) {
        LayerDoc* doc = open(edit.layer);
        if (!doc) {
            doc = &docs_[edit.layer];
            absent.insert(edit.layer);
        }
        doc->reserveIds(firstNode);
    }

    Outcome outcome =
        usdlive::execute(docs_, names_, creations_, transaction, confirmed_->revision + 1);
    for (const LayerId& layer : absent) docs_.erase(layer);
    if (auto* refused = std::get_if<Refused>(&outcome)) {
        landed.prognosis.complete = false;
        landed.prognosis.refused = true;
        landed.prognosis.names = names_.mark();
        landed.refused = std::move(*refused);
        return landed;
    }

    Executed& executed = std::get<Executed>(outcome);
    landed.prognosis.complete = executed.dropped.empty();
    landed.prognosis.names = names_.mark();
    auto dropped = executed.dropped.begin();
    std::uint32_t index = 0;
    for (ExecutedEdit& done : executed.edits) {
        for (; dropped != executed.dropped.end() && dropped->index == index; ++dropped) ++index;
        std::optional<Creation> creation;
        if (own) creation = Creation{transaction.id.sequence, index};
        if (!absent.contains(done.edit.layer))
            note(done.edit, done.applied, creation, landed.prognosis);
        // ED9: the executor appends edits to those of the transaction.
        if (wantEdits && index < landed.edits.size())
            landed.edits[index] =
                AuthoredEdit{std::move(done.edit.layer), std::move(done.edit.address.path),
                             std::move(done.edit.action)};
        ++index;
    }
    return landed;
}

// Notes what later addresses, effect() and the order of sending need to know about an edit.
void Prediction::note(const Edit& executed, const LayerDoc::Applied& applied,
                      const std::optional<Creation>& creation, Prognosis& prognosis) {
    const std::string& path = executed.address.path;
    LayerNotes& notes = notes_[executed.layer];
    prognosis.touched.push_back({executed.layer, path});
    if (const std::string* field = fieldOf(executed.action)) {
        std::uint64_t& whole = notes.fields[fieldKey(path, *field)];
        if (creation && writesWhole(executed.action)) whole = creation->sequence;
        return;
    }
    notes.structural.push_back(path);
    if (std::holds_alternative<CreateSpec>(executed.action)) {
        // Also if the spec was there already (M2): others may delete it before the server executes
        // the transaction. The later edits are then for the spec that it creates.
        if (creation) notes.created.insert_or_assign(applied.node, *creation);
    } else if (const auto* move = std::get_if<MoveSpec>(&executed.action);
               move && applied.changed) {
        std::string to = destination(path, *move);
        prognosis.touched.push_back({executed.layer, to});
        notes.structural.push_back(to);
        notes.moves.add(path, std::move(to));
    }
}

Result<Edit> Prediction::author(const AuthoredEdit& edit, const Creation& creation,
                                Prognosis& prognosis) {
    LayerDoc* doc = open(edit.layer);
    if (!doc)
        return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
    doc->reserveIds(ownBlock(creation.sequence));
    Result<Edit> result = addressed(edit, *doc);
    if (!result) return result;
    const auto applied = doc->apply(edit.path, edit.action, LayerDoc::By::Author);
    if (!applied) return tl::unexpected(applied.error());

    const Edit executed{edit.layer, {edit.path, {}}, edit.action};
    note(executed, *applied, creation, prognosis);
    if (std::holds_alternative<CreateSpec>(edit.action))
        creations_.record(creation, {edit.layer, edit.path, names_.mark()},
                          confirmed_->revision + 1);
    else if (std::holds_alternative<DeleteSpec>(edit.action))
        names_.recordDelete(confirmed_->revision + 1, edit.layer, edit.path);
    else if (const auto* move = std::get_if<MoveSpec>(&edit.action); move && applied->changed)
        names_.recordMove(confirmed_->revision + 1, edit.layer, edit.path,
                          destination(edit.path, *move));
    prognosis.names = names_.mark();
    return result;
}

Result<Edit> Prediction::addressed(const AuthoredEdit& edit, const LayerDoc& doc) const {
    const bool creates = std::holds_alternative<CreateSpec>(edit.action);
    auto target =
        creates ? childAddress(edit.layer, doc, edit.path) : address(edit.layer, doc, edit.path);
    if (!target) return tl::unexpected(target.error());
    Edit result{edit.layer, std::move(*target), edit.action};
    if (auto* move = std::get_if<MoveSpec>(&result.action)) {
        auto parent = address(edit.layer, doc, move->parent.path);
        if (!parent) return tl::unexpected(parent.error());
        move->parent = std::move(*parent);
    }
    return result;
}

// The address of a spec that exists. If own pending work created it, the address is that creation.
// Otherwise the spec is a confirmed one, and the predicted moves have changed its path. Going back
// through them gives its confirmed path.
Result<Address> Prediction::address(const LayerId& layer, const LayerDoc& doc,
                                    std::string_view path) const {
    const auto elements = specpath::parse(path);
    if (!elements) return tl::unexpected(elements.error());
    const std::vector<NodeId> ids = doc.idsAlong(path);
    if (ids.size() != elements->size() + 1)
        return fail(ErrorCode::SpecNotFound, "no spec at " + std::string(path));

    const auto notes = notes_.find(layer);
    if (notes != notes_.end())
        if (const auto own = notes->second.created.find(ids.back());
            own != notes->second.created.end())
            return Address{{}, own->second};
    if (ids.back() >= kFirstPreviewed)
        return fail(ErrorCode::SpecNotFound,
                    "the spec " + std::string(path) + " is only another's preview so far");
    return Address{
        notes == notes_.end() ? std::string(path) : notes->second.moves.undone(std::string(path)),
        {}};
}

// The address of a spec that an edit is to create: its parent's address and its name.
Result<Address> Prediction::childAddress(const LayerId& layer, const LayerDoc& doc,
                                         std::string_view path) const {
    const auto elements = specpath::parse(path);
    if (!elements) return tl::unexpected(elements.error());
    if (elements->empty()) return Address{"/", {}};
    auto parent = address(layer, doc, specpath::parent(path));
    if (!parent) return parent;
    const PathElement& own = elements->back();
    if (!parent->creation) return Address{specpath::child(parent->path, own.list, own.name), {}};
    parent->path = relativePath(path, specpath::parent(path));
    return parent;
}

Prediction::Effect Prediction::effect(const Edit& committed,
                                      const std::function<bool(std::uint64_t)>& isPending) const {
    if (!predicts(committed.layer)) return Effect::Applies;
    const std::string* field = fieldOf(committed.action);
    if (!field) return Effect::Invalidates;
    const auto notes = notes_.find(committed.layer);
    if (notes == notes_.end()) return Effect::Applies;
    const std::string& path = committed.address.path;
    const auto writes = [&](std::string_view other) {
        return notes->second.fields.contains(fieldKey(path, other));
    };
    const bool typed = std::ranges::find(kTypedFields, *field) != std::end(kTypedFields);
    if (*field == "typeName" && std::ranges::any_of(kTypedFields, writes))  // ED9
        return Effect::Invalidates;
    if (typed && writes("typeName")) return Effect::Invalidates;
    const auto& structural = notes->second.structural;
    if (structural.size() > kStructuralSearched ||
        std::any_of(structural.begin(), structural.end(),
                    [&](const std::string& changed) { return specpath::hasPrefix(path, changed); }))
        return Effect::Invalidates;
    const auto written = notes->second.fields.find(fieldKey(path, *field));
    if (written == notes->second.fields.end()) return Effect::Applies;
    // Other fields of the spec depend on these two.
    if (*field == "typeName" || *field == "specifier") return Effect::Invalidates;
    return written->second != 0 && isPending(written->second) ? Effect::None : Effect::Invalidates;
}

void Prediction::apply(const Edit& committed) {
    const auto own = docs_.find(committed.layer);
    if (own != docs_.end()) (void)own->second.apply(committed.address.path, committed.action);
}

void Prediction::acknowledge(std::uint64_t sequence, const Prognosis& prognosis) {
    names_.pruneBefore(prognosis.names);
    creations_.forget(sequence);
}

}  // namespace usdlive::client
