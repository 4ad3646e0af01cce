// The predicted side: own transactions and previews, executed on the confirmed layers (M7).
#include "session/Prediction.h"

#include <algorithm>
#include <iterator>
#include <set>

#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/PathsInValues.h"

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

// So many addresses and moves are tried to find what names a place.
constexpr std::size_t kMostTried = 256;

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

const std::string* fieldOf(const EditAction& action) {
    if (const auto* set = std::get_if<SetField>(&action)) return &set->field;
    if (const auto* erase = std::get_if<EraseField>(&action)) return &erase->field;
    return nullptr;
}

void collectBlobs(const EditAction& action, std::vector<Value>& blobs) {
    forEachBlob(action, [&](const Value& blob) { blobs.push_back(blob); });
}

void Prediction::Moves::add(std::string from, std::optional<std::string> to) {
    specs_.from.emplace(from, moves_.size());
    if (to) specs_.to.emplace(*to, moves_.size());
    if (to) carried_.emplace(*to, moves_.size());
    moves_.push_back({std::move(from), std::move(to), {}});
}

void Prediction::Moves::create(const std::string& path, const Creation& edit) {
    created_.push_back({path, moves_.size(), edit});
}

// If the spec at the place has moved or gone just before, the two are one.
void Prediction::Moves::vacate(std::string from, std::optional<std::string> to,
                               const std::optional<Creation>& edit, bool movesSpec) {
    std::size_t number = moves_.size();
    const auto last = lastAt(specs_.from, from);
    const auto isSince = [&](const std::string& path) {
        return std::max({lastAt(specs_.from, path), lastAt(specs_.to, path),
                         lastAt(places_.from, path), lastAt(places_.to, path)}) > last;
    };
    if (last && moves_[*last].to == to && !isSince(from) && !(to && isSince(*to))) {
        number = *last;
        specs_.from.erase({from, number});
        if (to) specs_.to.erase({*to, number});
        moves_[number].edit = edit;
    } else {
        if (to && movesSpec) carried_.emplace(*to, number);
        moves_.push_back({from, to, edit});
    }
    if (to) places_.to.emplace(*std::move(to), number);
    places_.from.emplace(std::move(from), number);
}

std::string Prediction::Moves::undone(std::string path) const {
    for (std::size_t end = moves_.size();;) {
        const auto last = lastOf(carried_, path, end);
        if (!last) return path;
        path = specpath::replacePrefix(path, *moves_[*last].to, moves_[*last].from);
        end = *last;
    }
}

std::optional<Address> Prediction::Moves::place(std::string path, const Leads& leads) const {
    std::size_t left = kMostTried;
    return placeBefore(std::move(path), moves_.size(), leads, left);
}

std::optional<Address> Prediction::Moves::object(std::string path) const {
    for (std::size_t end = moves_.size();;) {
        const Last last = this->last(path, end, false);
        if (last.created)
            return Address{relativePath(path, last.created->path), last.created->edit};
        if (!last.moved && !last.left) return Address{std::move(path), {}};
        if (last.left >= last.moved) return leftBy(moves_[*last.left], path);
        const Move& move = moves_[*last.moved];
        path = specpath::replacePrefix(path, *move.to, move.from);
        end = *last.moved;
    }
}

bool Prediction::Moves::movesOnlySpec(const std::string& path) const {
    const auto concerns = [&](const ByPath& paths) {
        const auto found = paths.lower_bound({path, 0});
        return found != paths.end() && found->first == path;
    };
    return concerns(specs_.from) || concerns(specs_.to);
}

// The spec that moved to a place is not what is created there afterwards, and another spec may have
// left it.
Prediction::Moves::Last Prediction::Moves::last(const std::string& path, std::size_t end,
                                                bool isPlace) const {
    const std::string spec = isPlace ? specpath::parent(path) : path;
    Last last{std::max(lastOf(places_.to, path, end), lastOf(specs_.to, spec, end)),
              std::max(lastOf(places_.from, path, end), lastOf(specs_.from, spec, end)),
              lastCreated(spec, end)};
    const auto move = std::max(last.moved, last.left);
    if (last.created && move && last.created->time <= *move) last.created = nullptr;
    return last;
}

// Returns what names a path below what a move has left; nothing if it was not an own edit of a
// place.
std::optional<Address> Prediction::Moves::leftBy(const Move& move, const std::string& path) {
    if (!move.edit) return std::nullopt;
    return Address{relativePath(path, move.from), move.edit};
}

// Tries at most `left` addresses and moves.
std::optional<Address> Prediction::Moves::placeBefore(std::string path, std::size_t end,
                                                      const Leads& leads, std::size_t& left) const {
    const auto checked = [&](std::optional<Address> address) {
        return address && leads(*address) ? std::move(address) : std::nullopt;
    };
    for (; left > 0; --left) {
        const Last last = this->last(path, end, true);
        if (last.created)
            return checked(Address{relativePath(path, last.created->path), last.created->edit});
        if (!last.moved && !last.left) return checked(Address{std::move(path), {}});
        if (last.left >= last.moved) return checked(leftBy(moves_[*last.left], path));
        // The spec that came there is another one if only the place was moved, or only the spec.
        const Move& move = moves_[*last.moved];
        std::string before = specpath::replacePrefix(path, *move.to, move.from);
        end = *last.moved;
        if (auto found = placeBefore(std::move(before), end, leads, left)) return found;
    }
    return std::nullopt;
}

// Returns the last spec at `path` or above that was created before move `end`.
const Prediction::Moves::Created* Prediction::Moves::lastCreated(std::string path,
                                                                 std::size_t end) const {
    for (; indexed_ < created_.size(); ++indexed_)
        createdByPath_[{created_[indexed_].path, created_[indexed_].time}] = indexed_;
    const Created* last = nullptr;
    for (; path.size() > 1; path = specpath::parent(path)) {
        const auto next = createdByPath_.upper_bound({path, end});
        if (next == createdByPath_.begin() || std::prev(next)->first.first != path) continue;
        const Created& created = created_[std::prev(next)->second];
        if (!last || created.time > last->time) last = &created;
    }
    return last;
}

// Returns the number of the last move of which `paths` has `path`.
std::optional<std::size_t> Prediction::Moves::lastAt(const ByPath& paths, const std::string& path) {
    const auto next = paths.upper_bound({path, ~std::size_t(0)});
    if (next == paths.begin() || std::prev(next)->first != path) return std::nullopt;
    return std::prev(next)->second;
}

// Returns the number of the last move before `end` of which `paths` has `path` or an ancestor.
std::optional<std::size_t> Prediction::Moves::lastOf(const ByPath& paths, std::string path,
                                                     std::size_t end) {
    std::optional<std::size_t> last;
    for (; path.size() > 1; path = specpath::parent(path)) {
        const auto next = paths.lower_bound({path, end});
        if (next != paths.begin() && std::prev(next)->first == path)
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

Expectation Prediction::run(const Transaction& transaction) {
    return execute(transaction, true, ownBlock(transaction.id.sequence), false).expectation;
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
        landed.expectation.complete = false;
        landed.expectation.refused = true;
        landed.expectation.names = names_.mark();
        landed.refused = std::move(*refused);
        return landed;
    }

    Executed& executed = std::get<Executed>(outcome);
    landed.expectation.complete = executed.dropped.empty();
    landed.expectation.names = names_.mark();
    SubmittedIndexes indexes(executed.dropped);
    for (std::size_t number = 0; number < executed.edits.size(); ++number) {
        ExecutedEdit& done = executed.edits[number];
        const std::uint32_t index = indexes.next();
        std::optional<Creation> creation;
        if (own && index < transaction.edits.size())
            creation = Creation{transaction.id.sequence, index};
        else if (own && concernsPlace(done.edit.action))
            creation = numberOfPlace(executed, number, transaction.id.sequence);
        if (!absent.contains(done.edit.layer))
            note(done.edit, done.applied, creation, landed.expectation);
        // ED9: the executor appends edits to those of the transaction.
        if (wantEdits && index < landed.edits.size()) {
            if (const auto unmerged = executed.unmerged.find(number);
                unmerged != executed.unmerged.end())
                std::get<SetField>(done.edit.action).value = std::move(unmerged->second);
            landed.edits[index] =
                AuthoredEdit{std::move(done.edit.layer), std::move(done.edit.address.path),
                             std::move(done.edit.action)};
        }
    }
    return landed;
}

// Returns the number of an edit of a place that had no effect until the executor moved the object
// under a new parent, after all edits.
std::optional<Creation> Prediction::numberOfPlace(const Executed& executed, std::size_t again,
                                                  std::uint64_t sequence) {
    const Edit& moved = executed.edits[again].edit;
    SubmittedIndexes indexes(executed.dropped);
    for (std::size_t number = 0; number < again; ++number) {
        const std::uint32_t index = indexes.next();
        const Edit& edit = executed.edits[number].edit;
        if (concernsPlace(edit.action) && !changesNamespace(edit) && edit.layer == moved.layer &&
            edit.address.path == moved.address.path)
            return Creation{sequence, index};
    }
    return std::nullopt;
}

// Notes what later addresses, effect() and the order of sending need to know about an edit.
void Prediction::note(const Edit& executed, const LayerDoc::Applied& applied,
                      const std::optional<Creation>& creation, Expectation& expectation) {
    const std::string& path = executed.address.path;
    LayerNotes& notes = notes_[executed.layer];
    expectation.touched.push_back({executed.layer, path});
    if (const std::string* field = fieldOf(executed.action)) {
        std::uint64_t& whole = notes.fields[fieldKey(path, *field)];
        if (creation && writesWhole(executed.action)) whole = creation->sequence;
        return;
    }
    notes.structural.push_back(path);
    notes.editsPlaces = notes.editsPlaces || concernsPlace(executed.action);
    if (std::holds_alternative<CreateSpec>(executed.action)) {
        // Also if the spec was there already (M2): others may delete it before the server executes
        // the transaction. The later edits are then for the spec that it creates.
        if (!creation) return;
        notes.created.insert_or_assign(applied.node, *creation);
        notes.moves.create(path, *creation);
    } else if (const auto* move = std::get_if<MoveSpec>(&executed.action);
               move && changesNamespace(executed)) {
        std::string to = destination(path, *move);
        expectation.touched.push_back({executed.layer, to});
        notes.structural.push_back(to);
        if (move->place)
            notes.moves.vacate(path, std::move(to), creation, applied.changed);
        else
            notes.moves.add(path, std::move(to));
    } else if (move && applied.node != 0) {
        return;  // it stays: something is in its way
    } else if (concernsPlace(executed.action)) {
        notes.moves.vacate(path, std::nullopt, creation, false);
    } else if (std::holds_alternative<DeleteSpec>(executed.action)) {
        notes.moves.add(path, std::nullopt);
    }
}

Result<Edit> Prediction::author(const AuthoredEdit& edit, const Creation& creation,
                                Expectation& expectation) {
    LayerDoc* doc = open(edit.layer);
    if (!doc)
        return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
    doc->reserveIds(ownBlock(creation.sequence));
    Result<Edit> result = addressed(edit, *doc);
    if (!result) return result;
    const auto applied = doc->apply(edit.path, edit.action, LayerDoc::By::Author);
    if (!applied) return tl::unexpected(applied.error());

    Edit executed{edit.layer, {edit.path, {}}, edit.action};
    if (concernsPlace(edit.action) && applied->node != 0 && !applied->changed)
        executed.action = stayingAt(edit.path);
    note(executed, *applied, creation, expectation);
    recordMove(names_, confirmed_->revision + 1, confirmed_->self, executed);
    if (std::holds_alternative<CreateSpec>(edit.action) || concernsPlace(edit.action))
        creations_.record(creation, {edit.layer, edit.path, names_.mark()},
                          confirmed_->revision + 1);
    expectation.names = names_.mark();
    return result;
}

Result<Edit> Prediction::addressed(const AuthoredEdit& edit, const LayerDoc& doc) const {
    const bool creates = std::holds_alternative<CreateSpec>(edit.action);
    const bool ofPlace = concernsPlace(edit.action);
    auto target = ofPlace   ? placeAddress(edit.layer, doc, edit.path)
                  : creates ? newAddress(edit.layer, doc, edit.path)
                            : address(edit.layer, doc, edit.path);
    if (!target) return tl::unexpected(target.error());
    Edit result{edit.layer, std::move(*target), edit.action, namesOf(edit)};
    if (auto* move = std::get_if<MoveSpec>(&result.action)) {
        auto parent = ofPlace ? parentOfPlace(edit.layer, doc, move->parent.path)
                              : address(edit.layer, doc, move->parent.path);
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

// The address of an object that moves, or of its new parent (M15).
Result<Address> Prediction::placeAddress(const LayerId& layer, const LayerDoc& doc,
                                         std::string_view path, Names names) const {
    if (const auto valid = specpath::parse(path); !valid) return tl::unexpected(valid.error());
    const auto notes = notes_.find(layer);
    if (notes == notes_.end() || notes->second.moves.empty()) return addressBelow(layer, doc, path);
    std::string place(path);
    auto named = notes->second.moves.place(
        place, [&](const Address& address) { return leadsTo(layer, address, place, names); });
    if (!named) return fail(ErrorCode::SpecNotFound, "nothing names " + place);
    return *std::move(named);
}

// Returns whether the server will find it there.
bool Prediction::leadsTo(const LayerId& layer, const Address& address, const std::string& path,
                         Names names) const {
    const AddressResolver resolver(
        names_, confirmed_->self, openedAt(layer),
        [this](const Creation& creation) { return creations_.find(creation); });
    return (names == Names::Place ? resolver.place(layer, address)
                                  : resolver.spec(layer, address)) == path;
}

// The address of a spec that is to be created.
Result<Address> Prediction::newAddress(const LayerId& layer, const LayerDoc& doc,
                                       std::string_view path) const {
    auto place = placeAddress(layer, doc, path);
    return place ? place : addressBelow(layer, doc, path);
}

// An address below the next spec above.
Result<Address> Prediction::addressBelow(const LayerId& layer, const LayerDoc& doc,
                                         std::string_view path) const {
    const auto elements = specpath::parse(path);
    if (!elements) return tl::unexpected(elements.error());
    if (elements->empty()) return Address{"/", {}};
    std::string above = specpath::parent(path);
    while (!doc.has(above)) above = specpath::parent(above);
    auto parent = address(layer, doc, above);
    if (!parent) return parent;
    if (parent->creation) return Address{relativePath(path, above), parent->creation};
    return Address{specpath::replacePrefix(path, above, parent->path), {}};
}

// The new parent of an object, which may have no spec here (M15).
Result<Address> Prediction::parentOfPlace(const LayerId& layer, const LayerDoc& doc,
                                          const std::string& path) const {
    if (doc.has(path)) return address(layer, doc, path);
    const auto notes = notes_.find(layer);
    if (notes != notes_.end() && notes->second.moves.movesOnlySpec(path))
        return fail(ErrorCode::SpecNotFound, "nothing names " + path);
    return placeAddress(layer, doc, path, Names::Parent);
}

// M15: what the paths in the values of an edit name; nothing if they are paths at the base.
std::vector<Address> Prediction::namesOf(const AuthoredEdit& edit) const {
    const auto notes = notes_.find(edit.layer);
    if (notes == notes_.end() || notes->second.moves.empty() || !mayHavePaths(edit.action))
        return {};
    std::vector<Address> names;
    bool differ = false;
    forEachPath(edit.action, [&](std::string_view path, PathRole role) {
        // A place keeps its name (a relocate): only its parent can have moved.
        const std::string parent = specpath::parent(path);
        auto name =
            notes->second.moves.object(role == PathRole::Place ? parent : std::string(path));
        if (name && role == PathRole::Place && !name->creation) {
            const PathElement last = specpath::last(path);
            name->path = specpath::child(name->path, last.list, last.name);
        } else if (role == PathRole::Place) {
            name.reset();
        }
        names.push_back(name.value_or(Address{}));
        differ = differ || names.back() != Address{std::string(path), {}};
    });
    return differ ? names : std::vector<Address>();
}

Prediction::Effect Prediction::effect(const Edit& committed,
                                      const std::function<bool(std::uint64_t)>& isPending) const {
    if (!predicts(committed.layer)) return Effect::Applies;
    const std::string* field = fieldOf(committed.action);
    if (!field) return Effect::Invalidates;
    const auto notes = notes_.find(committed.layer);
    if (notes == notes_.end()) return Effect::Applies;
    // Its paths may be corrected (M16).
    if (notes->second.editsPlaces && mayHavePaths(committed.action)) return Effect::Invalidates;
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

void Prediction::acknowledge(std::uint64_t sequence, const Expectation& expectation) {
    names_.pruneBefore(expectation.names);
    creations_.forget(sequence);
}

}  // namespace usdlive::client
