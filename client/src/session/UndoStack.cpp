// Steps of own work: their specs, their inverses, and what others have written since.
#include "session/UndoStack.h"

#include <algorithm>
#include <iterator>
#include <set>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/layer/FileRules.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::client {

namespace {

// Specs that are gone have paths below this one, which no spec can have.
constexpr std::string_view kDeleted = "/\x01";
constexpr const char* kDefaultLabel = "Edit";
// More writes of others into one spec, or below a created one, count as writes of everything.
constexpr std::size_t kMostOfSite = 1'000;

bool isGone(const std::string& path) { return path.starts_with(kDeleted); }

bool changesNothing(const Inverse& inverse) {
    const auto* written = std::get_if<WrittenRegister>(&inverse);
    return written ? !written->changed : std::holds_alternative<std::monostate>(inverse);
}

}  // namespace

/// A spec that steps name, at the path that the view has for it now.
struct UndoStack::Site : std::enable_shared_from_this<Site> {
    LayerId layer;
    std::string path;
    UserName goneBy;  // the user who has deleted it; empty: unknown, or this client

    struct Write {
        std::string field;
        FieldPart part;
        std::optional<FieldValue> content;
        Revision revision = 0;
        UserName author;
    };
    struct Change {
        Revision revision = 0;
        UserName author;
    };
    std::vector<Write> writes;    // by others, the last of each register
    Change any, moved, placed;    // by others; any: all registers
    std::uint64_t createdIn = 0;  // the own transaction that has created it; 0: none
    std::uint64_t movedIn = 0;    // the last one that has moved it; 0: none
    Revision createdSeen = 0;     // the newest commit that its author had seen then
    struct Below {
        SitePtr site;  // null: everything below
        UserName author;
        Revision revision = 0;  // the last write
        /// Set: others have not written it while it was below, but this direction has left it
        /// there.
        std::optional<Direction> keptBy = {};
    };
    std::vector<Below> below;  // a created or moved spec has here what others have written
};

/// The inverse of one edit.
struct UndoStack::Entry {
    std::uint32_t index = 0;
    SitePtr site, parent, next;
    ChildList list = ChildList::Prims;  // that has held the spec
    std::string name;                   // the name of a deleted spec
    bool changesParent = false;
    Inverse inverse;
};

/// The edits of one transaction in one step.
struct UndoStack::Part {
    std::uint64_t sequence = 0;
    Revision revision = 0;  // the revision of its commit; 0: it is pending
    Revision seen = 0;
    std::vector<Entry> entries;  // in the order of their edits
    // SE15: other steps have earlier or later values of the same edits.
    bool rewrites = false, rewritten = false;
    bool moves = false;  // it has moved specs that it has not created
    bool isLost = false;
};

struct UndoStack::Step {
    std::string label;
    std::vector<PartPtr> parts;
    std::vector<KeptByUndo> kept;
    StepPtr takenBack;  // the step that this one takes back, until it is committed
    std::size_t bytes = 0;
};

/// An edit of a commit that the view may not show yet.
struct UndoStack::Unread {
    Edit edit;
    std::uint64_t mark = 0;
    Revision revision = 0;
    UserName author;
    // Set for an own edit.
    std::weak_ptr<Part> part;
    std::uint32_t index = 0;
    std::optional<Inverse> inverse;
};

UndoStack::UndoStack(Bounds bounds) : bounds_(bounds) {}
UndoStack::~UndoStack() { clear(); }

// ---- specs and their paths

UndoStack::SitePtr UndoStack::site(const LayerId& layer, const std::string& path) {
    Sites& sites = sites_[layer];
    if (const auto found = sites.find(path); found != sites.end())
        return found->second->shared_from_this();
    const SitePtr made(new Site, [this](Site* old) {
        unlist(*old);
        delete old;
    });
    made->layer = layer;
    made->path = path;
    sites.emplace(path, made.get());
    return made;
}

template <class Visit>
void UndoStack::forEachAt(const LayerId& layer, const std::string& path, const Visit& visit) const {
    const auto sites = sites_.find(layer);
    if (sites == sites_.end()) return;
    const auto [begin, end] = sites->second.equal_range(path);
    for (auto at = begin; at != end; ++at) visit(*at->second);
}

void UndoStack::unlist(const Site& old) {
    const auto sites = sites_.find(old.layer);
    if (sites == sites_.end()) return;
    const auto [begin, end] = sites->second.equal_range(old.path);
    const auto found = std::find_if(begin, end, [&](const auto& at) { return at.second == &old; });
    if (found != end) sites->second.erase(found);
    if (sites->second.empty()) sites_.erase(sites);
}

// `from` is a copy: it may be the path of one of them.
void UndoStack::moveSites(const LayerId& layer, const std::string from, const std::string& to) {
    created_.reset();
    const auto sites = sites_.find(layer);
    if (sites == sites_.end() || from == to) return;
    // The variants of a set begin with "/A{set=", without the brace at the end.
    const std::string_view begin =
        std::string_view(from).substr(0, from.size() - (from.ends_with("=}") ? 1 : 0));
    std::vector<Sites::node_type> moved;
    for (auto at = sites->second.lower_bound(begin);
         at != sites->second.end() && at->first.starts_with(begin);) {
        const auto next = std::next(at);
        if (specpath::hasPrefix(at->first, from)) moved.push_back(sites->second.extract(at));
        at = next;
    }
    for (auto& one : moved) {
        one.key() = specpath::replacePrefix(one.key(), from, to);
        one.mapped()->path = one.key();
        sites->second.insert(std::move(one));
    }
}

// Gives a deleted spec, and those below it, paths that no other spec has, until it is restored.
void UndoStack::moveAside(const LayerId& layer, const std::string& path, const UserName& by) {
    const auto sites = sites_.find(layer);
    if (sites == sites_.end()) return;
    const PathElement last = specpath::last(path);
    std::string place = std::string(kDeleted) + std::to_string(++deletions_);
    if (last.list == ChildList::Variants) place += "{v=}";
    place = specpath::child(place, last.list, last.name);
    moveSites(layer, path, place);
    if (by.value.empty()) return;
    for (auto at = sites->second.lower_bound(place);
         at != sites->second.end() && specpath::hasPrefix(at->first, place); ++at)
        at->second->goneBy = by;
}

void UndoStack::shown(const LayerId& layer, const std::string& path, const EditAction& action) {
    if (!sites_.contains(layer)) return;
    if (const auto* move = std::get_if<MoveSpec>(&action))
        moveSites(layer, path, destination(path, *move));
    else if (std::holds_alternative<DeleteSpec>(action))
        moveAside(layer, path, deleter_);
}

// ---- steps

void UndoStack::begin(const std::string& label) {
    if (depth_++ == 0) current_ = std::make_shared<Step>();
    if (current_->label.empty()) current_->label = label;
}

void UndoStack::end() {
    if (depth_ == 0 || --depth_ > 0) return;
    const StepPtr step = std::exchange(current_, nullptr);
    overflows_ = false;
    std::erase_if(step->parts, [](const PartPtr& part) { return part->entries.empty(); });
    if (step->parts.empty()) return;
    if (step->label.empty()) step->label = kDefaultLabel;
    undo_.push_back(step);
    bound();
}

std::string UndoStack::label() const { return current_ ? current_->label : std::string(); }

UndoLabels UndoStack::labels() const {
    UndoLabels labels;
    for (const StepPtr& step : undo_) labels.undo.push_back(step->label);
    for (const StepPtr& step : redo_) labels.redo.push_back(step->label);
    return labels;
}

void UndoStack::bound() {
    std::size_t bytes = 0;
    for (const auto* steps : {&undo_, &redo_})
        for (const StepPtr& step : *steps) bytes += step->bytes;
    while (undo_.size() + redo_.size() > kMostSteps || bytes > bounds_.bytes) {
        auto& steps = undo_.empty() ? redo_ : undo_;
        if (steps.empty()) return;
        bytes -= std::min(bytes, steps.front()->bytes);
        steps.pop_front();
    }
}

void UndoStack::clear() {
    created_.reset();
    undo_.clear();
    redo_.clear();
    unread_.clear();
    pending_.clear();
    if (current_) current_->parts.clear();
    // Created specs may keep each other, if one was moved below the other.
    std::vector<SitePtr> left;
    for (const auto& [layer, sites] : sites_)
        for (const auto& [path, at] : sites) left.push_back(at->shared_from_this());
    for (const SitePtr& at : left) at->below.clear();
}

void UndoStack::forget(const LayerId& layer) {
    created_.reset();
    if (!sites_.contains(layer)) return;
    std::erase_if(unread_, [&](const Unread& one) { return one.edit.layer == layer; });
    const auto forgetIn = [&](Step& step) {
        for (const PartPtr& part : step.parts)
            std::erase_if(part->entries,
                          [&](const Entry& entry) { return entry.site->layer == layer; });
        std::erase_if(step.parts, [](const PartPtr& part) { return part->entries.empty(); });
        return step.parts.empty();
    };
    for (auto* steps : {&undo_, &redo_})
        std::erase_if(*steps, [&](const StepPtr& step) { return forgetIn(*step); });
    if (current_) forgetIn(*current_);
}

// ---- own edits

UndoStack::Part& UndoStack::partOf(std::uint64_t sequence, Revision seen) {
    if (!current_->parts.empty() && current_->parts.back()->sequence == sequence)
        return *current_->parts.back();
    auto& parts = pending_[sequence];
    std::erase_if(parts, [](const auto& part) { return part.expired(); });
    for (const auto& known : parts)
        if (const PartPtr part = known.lock();
            std::ranges::find(current_->parts, part) != current_->parts.end())
            return *part;
    const auto part = std::make_shared<Part>();
    part->sequence = sequence;
    part->seen = seen;
    part->rewrites = !parts.empty();
    for (const auto& known : parts) known.lock()->rewritten = true;
    parts.push_back(part);
    current_->parts.push_back(part);
    return *part;
}

bool UndoStack::isInOwnCreation(std::uint64_t sequence, const LayerId& layer,
                                std::string path) const {
    bool isOwn = false, isOther = false;
    for (; !isOwn && !isOther && path.size() > 1; path = specpath::parent(path))
        forEachAt(layer, path, [&](const Site& at) {
            isOwn = isOwn || at.createdIn == sequence;
            isOther = isOther || at.movedIn == sequence;  // it was moved into what was created
        });
    return isOwn;
}

bool UndoStack::goesWithCreated(std::uint64_t sequence, const AuthoredEdit& edit) const {
    return created_ && created_->sequence == sequence && created_->layer == edit.layer &&
           !std::holds_alternative<MoveSpec>(edit.action) &&
           !std::holds_alternative<DeleteSpec>(edit.action) &&
           specpath::hasPrefix(edit.path, created_->path);
}

void UndoStack::insert(Part& part, Entry entry) {
    const auto at = std::ranges::upper_bound(part.entries, entry.index, {}, &Entry::index);
    part.entries.insert(at, std::move(entry));
}

// Returns nothing for an edit of something that the transaction itself has created: that goes as a
// whole.
std::optional<UndoStack::Entry> UndoStack::entryOf(Part& part, const LayerId& layer,
                                                   const std::string& path,
                                                   const EditAction& action, Inverse inverse) {
    const std::uint64_t sequence = part.sequence;
    const bool isOwn = isInOwnCreation(sequence, layer, path);
    Entry entry;
    const auto sibling = [&](const std::string& parent, const std::string& name) {
        return name.empty() ? SitePtr() : site(layer, specpath::child(parent, entry.list, name));
    };
    const auto noteParent = [&](const std::string& next) {
        const std::string parent = specpath::parent(path);
        entry.list = specpath::last(path).list;
        entry.parent = site(layer, parent);
        entry.next = sibling(parent, next);
    };
    if (std::holds_alternative<CreatedSpec>(inverse)) {
        if (isOwn) return std::nullopt;
        entry.site = site(layer, path);
        entry.site->createdIn = sequence;
        entry.site->createdSeen = part.seen;
        created_ = Created{sequence, layer, path};
    } else if (const auto* deleted = std::get_if<DeletedSpec>(&inverse)) {
        noteParent(deleted->next);
        entry.name = specpath::last(path).name;
        entry.site = site(layer, path);
        moveAside(layer, path, {});
        if (isOwn && !part.moves) return std::nullopt;
    } else if (const auto* moved = std::get_if<MovedSpec>(&inverse)) {
        noteParent(moved->next);
        const std::string to = destination(path, std::get<MoveSpec>(action));
        const std::string above = specpath::parent(to);
        entry.changesParent = above != moved->parent;
        const bool staysOwn = isInOwnCreation(sequence, layer, above);
        entry.site = site(layer, path);
        moveSites(layer, path, to);
        if (isOwn && (staysOwn || entry.site->createdIn == sequence)) return std::nullopt;
        if (isOwn) {  // it has left what goes as a whole
            entry.site->createdIn = sequence;
            entry.site->createdSeen = part.seen;
            inverse = CreatedSpec();
        } else {
            entry.site->movedIn = sequence;
            part.moves = true;
        }
    } else if (isOwn) {
        return std::nullopt;
    } else {
        if (const auto* placed = std::get_if<PlacedSpec>(&inverse)) noteParent(placed->next);
        entry.site = site(layer, path);
    }
    entry.inverse = std::move(inverse);
    return entry;
}

void UndoStack::add(std::uint64_t sequence, std::uint32_t index, const AuthoredEdit& edit,
                    Inverse inverse, const LayerDoc& doc, Revision seen) {
    if (!takesBack_) redo_.clear();
    if (overflows_) return;
    completeInverse(inverse, doc, edit.path);
    Part& part = partOf(sequence, seen);
    const auto same = std::ranges::lower_bound(part.entries, index, {}, &Entry::index);
    if (same != part.entries.end() && same->index == index)
        return completeInverse(same->inverse, doc, edit.path);
    if (changesNothing(inverse)) return;
    auto entry = entryOf(part, edit.layer, edit.path, edit.action, std::move(inverse));
    if (!entry) return;
    entry->index = index;
    current_->bytes += memoryOf(entry->inverse);
    insert(part, *std::move(entry));
    if (current_->bytes <= bounds_.bytes || takesBack_) return;
    overflows_ = true;
    undo_.clear();
    current_->parts.clear();
}

void UndoStack::removed(std::uint64_t sequence, std::uint32_t index) {
    created_.reset();
    const auto parts = pending_.find(sequence);
    if (parts == pending_.end()) return;
    for (const auto& known : parts->second) {
        const PartPtr part = known.lock();
        if (!part) continue;
        std::erase_if(part->entries, [&](const Entry& entry) { return entry.index == index; });
        for (Entry& entry : part->entries)
            if (entry.index > index) --entry.index;
    }
}

void UndoStack::lost(std::uint64_t sequence) {
    created_.reset();
    const auto found = pending_.extract(sequence);
    if (!found) return;
    for (const auto& known : found.mapped()) {
        const PartPtr part = known.lock();
        if (!part) continue;
        for (auto entry = part->entries.rbegin(); entry != part->entries.rend(); ++entry)
            if (std::holds_alternative<DeletedSpec>(entry->inverse) && isGone(entry->site->path) &&
                !isGone(entry->parent->path))
                moveSites(entry->site->layer, entry->site->path,
                          specpath::child(entry->parent->path, entry->list, entry->name));
        part->isLost = true;
        part->entries.clear();
    }
    sweep();
}

// Removes lost parts, and steps that have no others. What such a step has taken back is there
// again.
void UndoStack::sweep() {
    const auto sweepStep = [](Step& step) {
        return std::erase_if(step.parts, [](const PartPtr& part) { return part->isLost; }) > 0 &&
               step.parts.empty();
    };
    std::vector<StepPtr> back[2];
    std::deque<StepPtr>* const stacks[] = {&undo_, &redo_};
    for (std::size_t which : {0, 1})
        std::erase_if(*stacks[which], [&](const StepPtr& step) {
            if (!sweepStep(*step)) return false;
            if (step->takenBack && !sweepStep(*step->takenBack))
                back[1 - which].push_back(step->takenBack);
            return true;
        });
    for (std::size_t which : {0, 1})
        for (const StepPtr& step : back[which])
            if (!step->parts.empty()) stacks[which]->push_back(step);
    if (current_) sweepStep(*current_);
    bound();
}

// ---- commits

void UndoStack::committed(std::uint64_t sequence, Revision revision,
                          std::vector<Executed> executed) {
    const auto found = pending_.extract(sequence);
    if (!found) return;
    for (const auto& known : found.mapped()) {
        const PartPtr part = known.lock();
        if (!part) continue;
        part->revision = revision;
        if (part->rewrites || part->rewritten)
            refine(*part, executed);
        else
            replaceEntries(part, revision, executed);
    }
    for (const auto* steps : {&undo_, &redo_})
        for (const StepPtr& step : *steps)
            if (step->takenBack && std::ranges::all_of(step->parts, [](const PartPtr& part) {
                    return part->revision != 0;
                }))
                step->takenBack.reset();
}

// Takes the inverses of the commit. Those of edits that have no entry yet follow when the view
// shows the commit.
void UndoStack::replaceEntries(const PartPtr& part, Revision revision,
                               std::vector<Executed>& executed) {
    std::set<std::pair<LayerId, std::string>> created, moved;  // confirmed paths
    const auto isInCreated = [&](const LayerId& layer, std::string path) {
        for (; path.size() > 1 && !moved.contains({layer, path}); path = specpath::parent(path))
            if (created.contains({layer, path})) return true;
        return false;
    };
    std::vector<Entry> entries;
    for (Executed& one : executed) {
        const LayerId& layer = one.edit->layer;
        const std::string& path = one.edit->address.path;
        const bool isOwn = isInCreated(layer, path);
        if (std::holds_alternative<CreatedSpec>(one.inverse)) created.emplace(layer, path);
        if (const auto* move = std::get_if<MoveSpec>(&one.edit->action))
            (isOwn ? created : moved).emplace(layer, destination(path, *move));
        const auto entry = std::ranges::lower_bound(part->entries, one.index, {}, &Entry::index);
        if (entry == part->entries.end() || entry->index != one.index) {
            if (!changesNothing(one.inverse) && !isOwn &&
                !std::holds_alternative<DeletedSpec>(one.inverse))
                unread_.push_back({.edit = *one.edit,
                                   .mark = one.mark,
                                   .revision = revision,
                                   .author = {},
                                   .part = part,
                                   .index = one.index,
                                   .inverse = std::move(one.inverse)});
            continue;
        }
        const bool isCreated = std::holds_alternative<CreatedSpec>(entry->inverse);
        if (isCreated && std::holds_alternative<MoveSpec>(one.edit->action)) {
            entries.push_back(std::move(*entry));
        } else if (entry->inverse.index() == one.inverse.index() && !changesNothing(one.inverse)) {
            entries.push_back(std::move(*entry));
            entries.back().inverse = std::move(one.inverse);
        } else if (isCreated) {
            entry->site->createdIn = 0;  // somebody else has created it
        }
    }
    part->entries = std::move(entries);
}

// SE15: the first of several parts has replaced what the commit has replaced, and the last one has
// left what the commit has left.
void UndoStack::refine(Part& part, const std::vector<Executed>& executed) {
    for (const Executed& one : executed) {
        const auto entry = std::ranges::lower_bound(part.entries, one.index, {}, &Entry::index);
        if (entry == part.entries.end() || entry->index != one.index) continue;
        auto* written = std::get_if<WrittenRegister>(&entry->inverse);
        const auto* committed = std::get_if<WrittenRegister>(&one.inverse);
        if (!written || !committed) continue;
        if (!part.rewrites) {
            written->own.before = committed->own.before;
            if (part.rewritten) continue;
        }
        if (!part.rewritten) written->own.after = committed->own.after;
    }
}

void UndoStack::othersCommitted(const NamespaceLog& log, const Commit& commit) {
    if (sites_.empty()) return;
    const bool concerns = std::ranges::any_of(
        commit.edits, [&](const Edit& edit) { return sites_.contains(edit.layer); });
    if (!concerns) return;
    deleter_ = commit.user;
    forEachExecuted(log, commit, [&](const Edit& edit, std::uint32_t, std::uint64_t mark) {
        if (!sites_.contains(edit.layer) || std::holds_alternative<DeleteSpec>(edit.action)) return;
        unread_.push_back({.edit = edit,
                           .mark = mark,
                           .revision = commit.revision,
                           .author = commit.user,
                           .part = {},
                           .index = 0,
                           .inverse = {}});
    });
    if (unread_.size() > bounds_.unread) clear();
}

Revision UndoStack::oldestNeeded(Revision otherwise) const {
    return unread_.empty() ? otherwise : std::min(otherwise, unread_.front().revision - 1);
}

void UndoStack::follow(const PathInView& pathInView) {
    for (Unread& one : std::exchange(unread_, {})) {
        const auto* move = std::get_if<MoveSpec>(&one.edit.action);
        const std::string& before = one.edit.address.path;
        const auto path =
            pathInView(one.edit.layer, move ? destination(before, *move) : before, one.mark);
        if (!path) continue;
        if (one.inverse)
            readOwn(one, *path);
        else
            readOthers(one, *path);
    }
    deleter_ = {};
}

// An edit that the executor has added, or that has become one of something that was there already.
void UndoStack::readOwn(Unread& one, const std::string& path) {
    const PartPtr part = one.part.lock();
    if (!part) return;
    Entry entry;
    entry.index = one.index;
    entry.site = site(one.edit.layer, path);
    if (std::holds_alternative<CreatedSpec>(*one.inverse)) {
        entry.site->createdIn = part->sequence;
        entry.site->createdSeen = part->seen;
    } else if (!std::holds_alternative<WrittenRegister>(*one.inverse)) {
        return;
    }
    entry.inverse = *std::move(one.inverse);
    insert(*part, std::move(entry));
}

void UndoStack::readOthers(const Unread& one, const std::string& path) {
    const LayerId& layer = one.edit.layer;
    const Site::Change change{one.revision, one.author};
    const auto noteWrite = [&](Site& at, const std::string& field, const FieldPart& part,
                               std::optional<FieldValue> content) {
        std::erase_if(at.writes, [&](const Site::Write& earlier) {
            return earlier.field == field && earlier.part == part;
        });
        if (at.writes.size() >= kMostOfSite) at.any = change;
        if (at.writes.size() < kMostOfSite)
            at.writes.push_back({field, part, std::move(content), one.revision, one.author});
    };
    forEachAt(layer, path, [&](Site& at) {
        const Overloaded note{
            [&](const SetField& set) {
                const auto* item = std::get_if<ListItem>(&set.part);
                noteWrite(at, set.field, set.part, item ? FieldValue(item->item) : set.value);
            },
            [&](const EraseField& erase) { noteWrite(at, erase.field, erase.part, {}); },
            [&](const MoveSpec&) { at.moved = change; },
            [&](const PlaceSpec&) { at.placed = change; },
            [](const CreateSpec&) {},
            [](const DeleteSpec&) {}};
        std::visit(note, one.edit.action);
    });
    noteBelowCreated(layer, path, path, one.author, one.revision, {});
}

// Notes for the created specs at `first` and above that `path` must not go with them. A moved spec
// may return below a created one. If it has come from `except`, those above that are left out, and
// those that were created, or restored, after the write.
void UndoStack::noteBelowCreated(const LayerId& layer, const std::string& path,
                                 const std::string& first, const UserName& author,
                                 Revision revision, std::optional<Direction> keptBy,
                                 const std::string& except) {
    std::vector<Site*> created;
    for (std::string above = first;
         above.size() > 1 && (except.empty() || !specpath::hasPrefix(except, above));
         above = specpath::parent(above))
        forEachAt(layer, above, [&](Site& at) {
            const bool isKnown = !except.empty() && at.createdSeen >= revision;
            if ((at.createdIn != 0 && !isKnown) || at.movedIn != 0) created.push_back(&at);
        });
    if (created.empty()) return;
    const SitePtr written = site(layer, path);
    for (Site* at : created) {
        const auto known = std::ranges::find_if(at->below, [&](const Site::Below& one) {
            return (!one.site || one.site == written) && (!one.keptBy || one.keptBy == keptBy);
        });
        if (known != at->below.end()) {
            known->revision = std::max(known->revision, revision);
            continue;
        }
        // A spec does not own itself.
        const bool isAll = at->below.size() >= kMostOfSite || at == written.get();
        at->below.push_back({isAll ? SitePtr() : written, author, revision, keptBy});
    }
}

// ---- undo

/// Takes the edits of one step back, the last one first.
class UndoStack::TakingBack {
public:
    TakingBack(UndoStack& stack, Direction direction, const View& view, const Author& author,
               std::vector<KeptByUndo>& kept)
        : stack_(stack), direction_(direction), view_(view), author_(author), kept_(kept) {}

    void run(const Part& part) {
        for (auto entry = part.entries.rbegin(); entry != part.entries.rend(); ++entry) {
            part_ = &part;
            entry_ = &*entry;
            if (doc())
                std::visit(*this, entry->inverse);
            else
                keep("its layer is not open");
        }
    }

    void operator()(std::monostate) {}

    void operator()(const WrittenRegister& noted) {
        if (isGone(path()) || !doc()->has(path()))
            return keep("it is not there any more", entry_->site->goneBy, noted.field,
                        noted.own.part);
        const WrittenRegister written = asPending(noted);
        UserName other;
        const auto isOthers = [&](const FieldPart& part) { return hasOther(written, part, other); };
        const auto actions =
            restoredRegister(written, doc()->field(path(), written.field), isOthers);
        if (!actions && other.value.empty()) isOthers(written.own.part);
        if (!actions)
            return keep(other.value.empty() ? "it has another value now" : "it was written since",
                        other, written.field, written.own.part);
        const SpecKind kind = *doc()->kind(path());
        for (const EditAction& action : *actions) {
            // ED8: an attribute has no type only before the edit that goes back next, its creation.
            if (std::holds_alternative<EraseField>(action) && !checkTypeName(kind, action))
                continue;
            if (auto done = make(path(), action); !done)
                return keep(done.error().message, {}, written.field, written.own.part);
        }
        if (!other.value.empty())  // some parts stay
            keep("some of it was written since", other, written.field, written.own.part);
    }

    void operator()(const CreatedSpec&) {
        if (isGone(path()) || !doc()->has(path())) return;
        std::vector<std::string> wanted;
        for (const Site::Below& below : entry_->site->below) {
            const std::string& at = below.site ? below.site->path : path();
            if (!specpath::hasPrefix(at, path()) || !doc()->has(at)) continue;
            if (below.keptBy && below.keptBy != direction_) continue;
            wanted.push_back(at);
            kept_.push_back({entry_->site->layer,
                             at,
                             {},
                             {},
                             below.author,
                             reason("it was written below what is undone", below.author)});
        }
        if (!wanted.empty()) return deleteAround(path(), wanted);
        if (auto done = make(path(), DeleteSpec{}); !done) keep(done.error().message);
    }

    void operator()(const DeletedSpec& deleted) {
        const auto target = formerPath(entry_->name);
        if (!target) return;
        if (doc()->has(*target)) return keep("another spec has its name now");
        for (auto& [at, action] : restoredSpecs(deleted.content, *target))
            if (auto done = make(at, std::move(action)); !done) return keep(done.error().message);
        stack_.moveSites(entry_->site->layer, path(), *target);
        placeBefore(*target);
    }

    void operator()(const MovedSpec& moved) {
        if (isGone(path())) return keep("it is not there any more", entry_->site->goneBy);
        if (isOthers(entry_->site->moved))
            return keepMoved("it was moved since", entry_->site->moved.author);
        const auto target = formerPath(moved.name);
        if (!target) return noteStays(entry_->parent->goneBy);
        if (*target != path()) {
            const std::string from = path(), parent = entry_->parent->path;
            if (auto done = make(path(), MoveSpec{{parent, {}}, moved.name, moved.place}); !done)
                return keepMoved(done.error().message, {});
            noteOthersBelow(from);
        }
        if (entry_->changesParent && doc()->has(path())) placeBefore(path());
    }

    void operator()(const PlacedSpec&) {
        if (isGone(path()) || !doc()->has(path())) return;
        if (isOthers(entry_->site->placed))
            return keep("it was placed since", entry_->site->placed.author);
        placeBefore(path());
    }

private:
    [[nodiscard]] const std::string& path() const { return entry_->site->path; }
    [[nodiscard]] const LayerDoc* doc() const { return view_(entry_->site->layer); }
    Result<void> make(std::string at, EditAction action) {
        return author_({entry_->site->layer, std::move(at), std::move(action)});
    }
    // A pending edit follows everything that others have committed.
    [[nodiscard]] bool isOthers(const Site::Change& change) const {
        return part_->revision != 0 && change.revision > part_->revision;
    }

    static std::string reason(const std::string& what, const UserName& author) {
        return author.value.empty() ? what : what + " by " + author.value;
    }
    void keep(const std::string& why, const UserName& author = {}, const std::string& field = {},
              const FieldPart& part = {}) {
        std::string at = path();
        if (isGone(at)) at = entry_->name;
        kept_.push_back(
            {entry_->site->layer, std::move(at), field, part, author, reason(why, author)});
    }
    void keepMoved(const std::string& why, const UserName& author) {
        keep(why, author);
        noteStays(author);
    }
    // A spec that stays below a created one must not go with it.
    void noteStays(const UserName& author) {
        if (!isGone(path()))
            stack_.noteBelowCreated(entry_->site->layer, path(), specpath::parent(path()), author,
                                    entry_->site->moved.revision, direction_);
    }

    // The spec has come from `from`, and may be below a created one now that others have not
    // written into. What they have written here must not go with that.
    void noteOthersBelow(const std::string& from) {
        if (isGone(path())) return;
        for (const Site::Below& below : std::vector(entry_->site->below))
            if (!below.keptBy || below.keptBy == direction_)
                stack_.noteBelowCreated(entry_->site->layer, below.site ? below.site->path : path(),
                                        specpath::parent(path()), below.author, below.revision,
                                        direction_, from);
    }

    bool hasOther(const WrittenRegister& written, const FieldPart& part, UserName& other) const {
        bool found = false;
        stack_.forEachAt(entry_->site->layer, path(), [&](const Site& at) {
            if (isOthers(at.any)) {
                other = at.any.author;
                found = true;
            }
            for (const Site::Write& write : at.writes) {
                if (write.field != written.field || !overlap(write.part, part) ||
                    !isOthers({write.revision, write.author}))
                    continue;
                other = write.author;
                found = true;
            }
        });
        return found;
    }

    // Others have committed a value before this pending edit: the edit replaces that one.
    [[nodiscard]] WrittenRegister asPending(WrittenRegister written) {
        if (part_->revision != 0) return written;
        stack_.forEachAt(entry_->site->layer, path(), [&](const Site& at) {
            for (const Site::Write& write : at.writes) {
                if (write.field != written.field || write.revision <= part_->seen ||
                    isWrittenEarlier(written))
                    continue;
                const auto& part = written.own.part;
                const auto* item = std::get_if<ListItem>(&part);
                const bool isSame =
                    item ? overlap(part, write.part) && write.part.index() == part.index()
                         : write.part == part;
                if (isSame)
                    written.own.before = write.content;
                else if (std::holds_alternative<std::monostate>(write.part))
                    written.own.before = contentOf(write.content ? &*write.content : nullptr, part);
            }
        });
        return written;
    }

    // Returns whether an earlier pending edit has written the register: what others have committed
    // is below that one.
    bool isWrittenEarlier(const WrittenRegister& written) {
        if (part_->rewrites) return true;
        if (!pendingWrites_) notePendingWrites();
        bool found = false;
        stack_.forEachAt(entry_->site->layer, path(), [&](const Site& at) {
            const auto [begin, end] = pendingWrites_->equal_range({&at, written.field});
            found = found || std::any_of(begin, end, [&](const auto& one) {
                        const PendingWrite& write = one.second;
                        const bool isEarlier = write.part == part_
                                                   ? write.index < entry_->index
                                                   : write.part->sequence < part_->sequence;
                        return isEarlier && overlap(write.written->own.part, written.own.part);
                    });
        });
        return found;
    }
    void notePendingWrites() {
        pendingWrites_.emplace();
        for (const auto& [sequence, parts] : stack_.pending_)
            for (const auto& known : parts) {
                const PartPtr part = known.lock();
                if (!part) continue;
                for (const Entry& entry : part->entries)
                    if (const auto* written = std::get_if<WrittenRegister>(&entry.inverse))
                        pendingWrites_->emplace(std::pair(entry.site.get(), written->field),
                                                PendingWrite{part.get(), entry.index, written});
            }
    }

    // The path at which the spec was, under its parent of now.
    [[nodiscard]] std::optional<std::string> formerPath(const std::string& name) {
        if (!isGone(entry_->parent->path))
            return specpath::child(entry_->parent->path, entry_->list, name);
        keep("its parent is not there any more", entry_->parent->goneBy);
        return std::nullopt;
    }

    void placeBefore(const std::string& at) {
        std::string next;
        if (entry_->next && !isGone(entry_->next->path) &&
            specpath::parent(entry_->next->path) == specpath::parent(at))
            next = specpath::last(entry_->next->path).name;
        if (doc()->nextSibling(at) == next) return;
        if (auto done = make(at, PlaceSpec{next}); !done) keep(done.error().message);
    }

    // Deletes what is below a spec, without `wanted` and what is above or below them.
    void deleteAround(const std::string& top, const std::vector<std::string>& wanted) {
        if (std::ranges::find(wanted, top) != wanted.end()) return;
        for (const ChildList list :
             {ChildList::Prims, ChildList::Properties, ChildList::VariantSets, ChildList::Variants})
            for (const std::string& name : doc()->children(top, list)) {
                const std::string below = specpath::child(top, list, name);
                if (std::ranges::any_of(wanted, [&](const std::string& one) {
                        return specpath::hasPrefix(one, below);
                    }))
                    deleteAround(below, wanted);
                else if (auto done = make(below, DeleteSpec{}); !done)
                    keep(done.error().message);
            }
    }

    UndoStack& stack_;
    const Direction direction_;
    const View& view_;
    const Author& author_;
    std::vector<KeptByUndo>& kept_;
    const Part* part_ = nullptr;
    const Entry* entry_ = nullptr;
    // The registers that pending edits have written, by spec and field; unset: not needed so far.
    struct PendingWrite {
        const Part* part;
        std::uint32_t index;
        const WrittenRegister* written;
    };
    std::optional<std::multimap<std::pair<const Site*, std::string>, PendingWrite>> pendingWrites_;
};

UndoResult UndoStack::takeBack(Direction direction, const View& view, const Author& author) {
    auto& from = direction == Direction::Undo ? undo_ : redo_;
    auto& to = direction == Direction::Undo ? redo_ : undo_;
    if (from.empty()) return {};
    const StepPtr step = std::move(from.back());
    from.pop_back();
    UndoResult result{true, step->label, step->kept};
    current_ = std::make_shared<Step>();
    current_->label = step->label;
    current_->takenBack = step;
    takesBack_ = true;
    TakingBack takingBack(*this, direction, view, author, result.kept);
    for (auto part = step->parts.rbegin(); part != step->parts.rend(); ++part)
        takingBack.run(**part);
    takesBack_ = false;
    current_->kept = result.kept;
    to.push_back(std::exchange(current_, nullptr));
    std::erase_if(to.back()->parts, [](const PartPtr& part) { return part->entries.empty(); });
    if (to.back()->parts.empty()) to.back()->takenBack.reset();
    bound();
    return result;
}

void UndoStack::forEachPendingBlob(const std::function<void(const Value&)>& visit) const {
    const auto ofContent = [&](const std::optional<FieldValue>& content) {
        if (content) forEachBlob(*content, visit);
    };
    for (const auto& [sequence, parts] : pending_)
        for (const auto& known : parts) {
            const PartPtr part = known.lock();
            if (!part) continue;
            for (const Entry& entry : part->entries)
                if (const auto* written = std::get_if<WrittenRegister>(&entry.inverse)) {
                    ofContent(written->own.before);
                    ofContent(written->own.after);
                }
        }
}

}  // namespace usdlive::client
