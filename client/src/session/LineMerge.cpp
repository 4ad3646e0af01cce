// Compares two lines of history, and carries the changes of one through those of the other.
#include "session/LineMerge.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <utility>

#include "session/OwnAddresses.h"
#include "session/Prediction.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/MatchedSpecs.h"

namespace usdlive::client {

namespace {

// The number of the only transaction.
constexpr std::uint64_t kTransaction = 1;

/// Notes the users of a commit's edits by the specs that they change.
class NotedUsers final : public AppliedEdits {
public:
    using Users = std::map<std::pair<LayerId, NodeId>, UserName>;
    NotedUsers(Users& users, const UserName& user) : users_(users), user_(user) {}

    void before(const LayerDoc& doc, const Edit& edit) override {
        if (!std::holds_alternative<CreateSpec>(edit.action)) note(doc, edit);
    }
    void after(const LayerDoc& doc, const Edit& edit) override {
        if (std::holds_alternative<CreateSpec>(edit.action)) note(doc, edit);
    }

private:
    void note(const LayerDoc& doc, const Edit& edit) {
        const auto ids = doc.idsAlong(edit.address.path);
        if (!ids.empty()) users_[{edit.layer, ids.back()}] = user_;
    }

    Users& users_;
    const UserName& user_;
};

using Paths = std::unordered_map<NodeId, std::string>;

Paths pathsIn(const LayerDoc& doc) {
    Paths paths;
    doc.visit([&](const LayerDoc::SpecView& spec) { paths.emplace(spec.node, spec.path); });
    return paths;
}

/// Returns the id of the spec at a path; 0: there is none.
NodeId idAt(const LayerDoc& doc, const std::string& path) {
    return doc.has(path) ? doc.idsAlong(path).back() : 0;
}

/// Returns the place in `merged` of a spec of `from` that is to be created again; nothing: what it
/// is in is not there. Specs of `common` have the same ids in all three.
std::optional<std::string> placeIn(const LayerDoc& merged, const LayerDoc& common,
                                   const LayerDoc& from, const std::string& path) {
    const std::string parent = specpath::parent(path);
    const NodeId above = idAt(from, parent);
    std::optional<std::string> now;
    if (pathsIn(common).contains(above)) {
        const auto paths = pathsIn(merged);
        if (const auto found = paths.find(above); found != paths.end()) now = found->second;
    } else {
        now = placeIn(merged, common, from, parent);
    }
    if (!now || !merged.has(*now)) return std::nullopt;
    return specpath::replacePrefix(path, parent, *now);
}

/// Says what becomes of a spec of `receiver` that was common and that `giver` has deleted.
enum class Deleted {
    Kept,     ///< it keeps its id
    Replaced  ///< it is the spec that `giver` has at its place now, if there is one
};

/// Returns the content of `receiver` with the ids of `giver` for the specs that both have: those
/// that both had in `common`, and those that are at the same place.
LayerDoc matchedLines(const LayerDoc& common, const LayerDoc& giver, const LayerDoc& receiver,
                      Deleted deleted) {
    const auto shared = pathsIn(common), given = pathsIn(giver), own = pathsIn(receiver);
    LayerDoc::Builder builder;
    std::unordered_map<NodeId, NodeId> ids{{0, 0}};
    NodeId next = std::max({common.nextId(), giver.nextId(), receiver.nextId()});
    const auto idIn = [&](const LayerDoc::SpecView& spec) -> NodeId {
        if (shared.contains(spec.node) && (given.contains(spec.node) || deleted == Deleted::Kept))
            return spec.node;
        const auto parent = given.find(ids.at(spec.parent));
        if (parent == given.end()) return 0;
        const std::string place(spec.path), above = specpath::parent(place);
        const std::string there = specpath::replacePrefix(place, above, parent->second);
        const NodeId found = idAt(giver, there);
        // A common spec that the receiver has elsewhere is another one.
        if (found == 0 || giver.kind(there) != spec.kind) return 0;
        return shared.contains(found) && own.contains(found) ? 0 : found;
    };
    receiver.visit([&](const LayerDoc::SpecView& spec) {
        const NodeId found = idIn(spec);
        const NodeId node = found != 0 ? found : next++;
        ids.emplace(spec.node, node);
        (void)builder.addSpec(node, ids.at(spec.parent), spec.order, spec.kind, spec.name);
        for (const auto& [name, value] : *spec.fields) (void)builder.addField(node, name, value);
    });
    return builder.finish();
}

/// Returns whether a spec goes away from its place.
bool leavesPlace(const EditAction& action) {
    return std::holds_alternative<MoveSpec>(action) || std::holds_alternative<DeleteSpec>(action);
}

Error impossible(const MergeConflict& conflict) {
    return {ErrorCode::InvalidArgument, conflict.layer.value + " " + conflict.path +
                                            " cannot be merged as it is: " + conflict.reason +
                                            ". Rename it in one of both, or take the "
                                            "other line there"};
}

const std::string* fieldWritten(const EditAction& action, FieldPart& part) {
    if (const auto* set = std::get_if<SetField>(&action)) {
        part = set->part;
        return &set->field;
    }
    if (const auto* erase = std::get_if<EraseField>(&action)) {
        part = erase->part;
        return &erase->field;
    }
    return nullptr;
}

}  // namespace

Result<void> LineMerge::Line::add(const Commit& commit) {
    NotedUsers noted(users, commit.user);
    revision = commit.revision;
    return applyCommit(docs, log, commit, &noted);
}

LineMerge::LineMerge(LayerDocs common, Revision revision)
    : common_(std::move(common)),
      revision_(revision),
      from_{common_, {}, revision, {}, {}},
      into_{common_, {}, revision, {}, {}} {}

Result<void> LineMerge::Line::change(const LayerId& layer, const LayerDoc& content) {
    Commit commit;
    commit.revision = revision + 1;
    for (auto& [path, action] : difference(docs.at(layer), content))
        commit.edits.push_back({layer, {path, {}}, std::move(action), {}});
    return applyCommit(docs, log, commit);
}

Result<void> LineMerge::Line::rebuild(const LayerDocs& base, const LayerDocs& contents) {
    const Line before = std::exchange(*this, Line{base, {}, revision, {}, apart});
    for (const auto& [layer, content] : contents)
        if (auto changed = change(layer, content); !changed) return changed;
    for (const auto& [layer, doc] : before.docs) {
        const auto paths = pathsIn(doc);
        for (const auto& [spec, user] : before.users)
            if (const auto path = paths.find(spec.second);
                spec.first == layer && path != paths.end())
                users[{layer, idAt(docs.at(layer), path->second)}] = user;
    }
    return {};
}

Result<void> LineMerge::setContent(Side side, const LayerId& layer, const LayerDoc& content) {
    Line& line = side == Side::From ? from_ : into_;
    const auto known = line.docs.find(layer);
    if (known == line.docs.end()) return {};
    line.apart.insert(layer);
    return line.change(layer, matchedSpecs(known->second, content));
}

Result<void> LineMerge::matchContents() {
    if (into_.apart.empty()) return {};
    LayerDocs contents = into_.docs;
    for (const LayerId& layer : into_.apart) {
        const LayerDoc& common = common_.at(layer);
        // The file of the layer may have had changes of the other line already.
        for (const LayerDoc* places : {&common, &std::as_const(from_).docs.at(layer)})
            contents[layer] = matchedLines(common, *places, contents.at(layer), Deleted::Kept);
    }
    return into_.rebuild(common_, contents);
}

Result<void> LineMerge::received(Side side) {
    Line& receiver = side == Side::From ? from_ : into_;
    Line& giver = side == Side::From ? into_ : from_;
    LayerDocs contents;
    for (const auto& [layer, given] : giver.docs)
        contents[layer] =
            matchedLines(common_.at(layer), given, receiver.docs.at(layer), Deleted::Replaced);
    giver.log = {};
    giver.users.clear();
    giver.apart.clear();
    receiver.apart.clear();
    common_ = giver.docs;
    revision_ = into_.revision;
    return receiver.rebuild(common_, contents);
}

std::vector<LayerId> LineMerge::changed() const {
    std::vector<LayerId> layers;
    for (const auto& [layer, doc] : from_.docs)
        if (!(doc == common_.at(layer))) layers.push_back(layer);
    std::ranges::sort(layers);
    return layers;
}

/// One layer in both lines, and when they parted. Specs that were there then have the same ids in
/// all three.
class LineMerge::Comparison {
public:
    Comparison(const LineMerge& merge, const LayerId& layer)
        : merge_(merge),
          layer_(layer),
          common_(merge.common_.at(layer)),
          from_(merge.from_.docs.at(layer)),
          into_(merge.into_.docs.at(layer)),
          paths_(pathsIn(common_)),
          fromPaths_(pathsIn(from_)),
          intoPaths_(pathsIn(into_)),
          evolving_(common_) {}

    /// Returns the conflict of the next edit of difference(common, from), if it has one.
    Result<std::optional<MergeConflict>> next(const std::string& path, const EditAction& action) {
        auto conflict = conflictOf(path, action);
        if (auto applied = evolving_.apply(path, action); !applied)
            return tl::unexpected(applied.error());
        if (!conflict || conflict->field.empty()) return conflict;
        const FieldValue* const field = evolving_.field(path, conflict->field);
        conflict->from = contentOf(field, conflict->part);
        if (conflict->from == conflict->into) conflict.reset();
        return conflict;
    }

    /// Returns where the spec at a path of `evolving_` is in the other line, or would be; nothing:
    /// the line has deleted it.
    [[nodiscard]] std::optional<std::string> pathInto(const std::string& path) const {
        const NodeId node = nodeAt(path);
        if (isCommon(node)) {
            const auto there = intoPaths_.find(node);
            return there == intoPaths_.end() ? std::nullopt : std::optional(there->second);
        }
        const std::string parent = specpath::parent(path);
        if (parent == path) return path;
        const auto above = pathInto(parent);
        if (!above) return std::nullopt;
        return specpath::replacePrefix(path, parent, *above);
    }

private:
    [[nodiscard]] bool isCommon(NodeId node) const { return paths_.contains(node); }
    [[nodiscard]] NodeId nodeAt(const std::string& path) const {
        return evolving_.has(path) ? evolving_.idsAlong(path).back() : 0;
    }
    [[nodiscard]] static UserName userOf(const Line& line, const LayerId& layer, NodeId node) {
        const auto found = line.users.find({layer, node});
        return found == line.users.end() ? UserName() : found->second;
    }

    [[nodiscard]] MergeConflict conflict(MergeConflict::What what, const std::string& path,
                                         NodeId node) const {
        MergeConflict found;
        found.what = what;
        found.layer = layer_;
        const auto now = fromPaths_.find(node);
        found.path = isCommon(node) && now != fromPaths_.end() ? now->second : path;
        const auto there = pathInto(path);
        found.intoUser = userOf(merge_.into_, layer_,
                                isCommon(node) ? node
                                : there        ? idAt(into_, *there)
                                               : NodeId(0));
        found.fromUser =
            userOf(merge_.from_, layer_, isCommon(node) ? node : idAt(from_, found.path));
        return found;
    }

    [[nodiscard]] std::optional<MergeConflict> conflictOf(const std::string& path,
                                                          const EditAction& action) const {
        using What = MergeConflict::What;
        const NodeId node = nodeAt(path);
        const bool creates = std::holds_alternative<CreateSpec>(action);
        if (const NodeId gone = goneAbove(creates || !isCommon(node) ? path : std::string()))
            return conflict(What::Deleted, path, topmostGone(gone));
        if (creates) return takenPlace(path);
        if (std::holds_alternative<PlaceSpec>(action) || node == 0) return std::nullopt;
        const bool isGone = isCommon(node) && !intoPaths_.contains(node);
        if (std::holds_alternative<DeleteSpec>(action)) {
            // Only what was there when the lines parted can be deleted by a difference.
            if (isGone || !hasChangedBelow(node)) return std::nullopt;
            auto found = conflict(What::Deleted, path, node);
            found.isDeletedFrom = true;
            found.intoUser = lastUserBelow(intoPaths_.at(node));
            return found;
        }
        // A difference may move a spec aside that it deletes afterwards.
        if (isCommon(node) && !fromPaths_.contains(node)) return std::nullopt;
        if (isGone) return conflict(What::Deleted, path, topmostGone(node));
        if (const auto* move = std::get_if<MoveSpec>(&action)) {
            const NodeId gone = goneAbove(specpath::child(
                move->parent.path, specpath::last(path).list, specpath::last(path).name));
            if (gone != 0) {
                auto found = conflict(What::Refused, path, node);
                found.reason = "its new parent is deleted";
                return found;
            }
            if (!isCommon(node) || !hasMoved(node) || isMovedAlike(node)) return std::nullopt;
            return conflict(What::Moved, path, node);
        }
        FieldPart part;
        const std::string* const field = fieldWritten(action, part);
        const auto there = pathInto(path);
        if (!field || !there || !into_.has(*there)) return std::nullopt;
        // A new spec meets one that the other line has created there, too.
        if (!isCommon(node) && isCommon(idAt(into_, *there))) return std::nullopt;
        const auto held = [&](const LayerDoc& doc, const std::string& at) {
            return doc.has(at) ? contentOf(doc.field(at, *field), part) : std::nullopt;
        };
        auto before = isCommon(node) ? held(common_, paths_.at(node)) : std::nullopt;
        auto into = held(into_, *there);
        if (into == before) return std::nullopt;
        auto found = conflict(What::Value, path, node);
        found.field = *field;
        found.part = part;
        found.before = std::move(before);
        found.into = std::move(into);
        return found;
    }

    /// Returns the conflict if the other line has moved a spec to the place of a new one.
    [[nodiscard]] std::optional<MergeConflict> takenPlace(const std::string& path) const {
        const auto there = pathInto(path);
        const NodeId other = there ? idAt(into_, *there) : 0;
        if (!isCommon(other) || !hasMoved(other)) return std::nullopt;
        // If the merged line has moved it, too, and before this, that is the conflict.
        const auto from = fromPaths_.find(other);
        if (from != fromPaths_.end() && hasMovedIn(from_, fromPaths_, other) &&
            idAt(evolving_, from->second) == other)
            return std::nullopt;
        auto found = conflict(MergeConflict::What::Refused, path, other);
        found.path = path;
        found.reason = "another spec was moved to " + *there;
        return found;
    }
    /// Returns whether the other line has changed a spec, or has created one below it.
    [[nodiscard]] bool hasChangedBelow(NodeId node) const {
        bool has = false;
        into_.visit(intoPaths_.at(node), [&](const LayerDoc::SpecView& spec) {
            has = has || !isCommon(spec.node) || hasMoved(spec.node) || differs(spec);
        });
        return has;
    }
    [[nodiscard]] bool differs(const LayerDoc::SpecView& spec) const {
        const std::string& before = paths_.at(spec.node);
        const auto names = common_.fieldNames(before);
        if (names.size() != spec.fields->size()) return true;
        return std::ranges::any_of(*spec.fields, [&](const auto& one) {
            const FieldValue* const held = common_.field(before, one.first);
            return !held || !(*held == one.second);
        });
    }
    [[nodiscard]] UserName lastUserBelow(const std::string& path) const {
        UserName user;
        into_.visit(path, [&](const LayerDoc::SpecView& spec) {
            if (user.value.empty()) user = userOf(merge_.into_, layer_, spec.node);
        });
        return user;
    }
    /// Returns whether a line has given the spec another name or parent.
    [[nodiscard]] bool hasMovedIn(const LayerDoc& line, const Paths& paths, NodeId node) const {
        const std::string &before = paths_.at(node), &now = paths.at(node);
        if (before == now) return false;
        if (specpath::last(before).name != specpath::last(now).name) return true;
        return idAt(common_, specpath::parent(before)) != idAt(line, specpath::parent(now));
    }
    [[nodiscard]] bool hasMoved(NodeId node) const { return hasMovedIn(into_, intoPaths_, node); }
    /// Returns whether both lines have given the spec the same name and parent.
    [[nodiscard]] bool isMovedAlike(NodeId node) const {
        const std::string &from = fromPaths_.at(node), &into = intoPaths_.at(node);
        if (specpath::last(from).name != specpath::last(into).name) return false;
        const std::string fromParent = specpath::parent(from), intoParent = specpath::parent(into);
        const NodeId parent = idAt(from_, fromParent);
        if (isCommon(parent)) return parent == idAt(into_, intoParent);
        // Both lines give new specs the same ids.
        return !isCommon(idAt(into_, intoParent)) && fromParent == intoParent;
    }
    /// Returns the nearest common spec above a path of `evolving_` if the other line has deleted
    /// it; else 0.
    [[nodiscard]] NodeId goneAbove(std::string path) const {
        while (path.size() > 1) {
            path = specpath::parent(path);
            const NodeId above = nodeAt(path);
            if (isCommon(above))
                return intoPaths_.contains(above) || !fromPaths_.contains(above) ? 0 : above;
        }
        return 0;
    }
    /// Returns the deleted spec that has to come back so that this one does: itself, or one that it
    /// is in, in the merged line.
    [[nodiscard]] NodeId topmostGone(NodeId node) const {
        for (;;) {
            const NodeId above = idAt(from_, specpath::parent(fromPaths_.at(node)));
            if (!isCommon(above) || intoPaths_.contains(above)) return node;
            node = above;
        }
    }

    const LineMerge& merge_;
    const LayerId layer_;
    const LayerDoc &common_, &from_, &into_;
    const Paths paths_, fromPaths_, intoPaths_;
    LayerDoc evolving_;  // common_ with the edits up to now
};

Result<LineMerge::Merged> LineMerge::merge(
    const std::function<Side(const MergeConflict&)>& decide) const {
    Merged merged;
    const ClientId self{"merge"};
    const NamespaceLog noMoves;
    const OwnCreations noCreations;
    const Prediction::Confirmed confirmed{common_, noMoves, noCreations, revision_, self};
    Prediction prediction(confirmed);
    Transaction transaction{.id = {self, kTransaction}, .base = revision_, .edits = {}};
    // Specs that the other line has deleted, and that are created again.
    std::vector<MergeConflict> again;
    std::set<std::uint32_t> leftOut;
    std::vector<std::string> paths;   // those of the edits
    std::vector<std::string> places;  // the specs that they change have these in the other line
    // Places in the other line that stay taken, because a move or delete from there is left out.
    std::set<std::pair<LayerId, std::string>> taken;
    for (const LayerId& layer : changed()) {
        Comparison comparison(*this, layer);
        std::map<std::string, Side> deleted;  // one decision for everything in a deleted spec
        for (auto& [path, action] : difference(common_.at(layer), from_.docs.at(layer))) {
            const Creation number{kTransaction, std::uint32_t(transaction.edits.size())};
            Expectation expectation;
            auto edit = prediction.author({layer, path, action}, number, expectation);
            if (!edit) return tl::unexpected(edit.error());
            std::string place = comparison.pathInto(path).value_or(std::string());
            auto conflict = comparison.next(path, action);
            if (!conflict) return tl::unexpected(conflict.error());
            if (*conflict) {
                const bool isGone = (*conflict)->what == MergeConflict::What::Deleted &&
                                    !(*conflict)->isDeletedFrom;
                const auto known = deleted.find((*conflict)->path);
                const bool isKnown = isGone && known != deleted.end();
                const Side side = isKnown ? known->second : decide(**conflict);
                if (side == Side::From && (*conflict)->what == MergeConflict::What::Refused)
                    return tl::unexpected(impossible(**conflict));
                if (side == Side::From && isGone && !isKnown) again.push_back(**conflict);
                if (side != Side::From || isGone) {
                    edit->address = OwnAddresses::unresolvable(number);
                    leftOut.insert(number.edit);
                    if (!isGone && leavesPlace(action)) taken.emplace(layer, place);
                }
                if (isGone) deleted.emplace((*conflict)->path, side);
                if (!isKnown) {
                    merged.conflicts.push_back(*std::move(*conflict));
                    merged.decisions.push_back(side);
                }
            }
            transaction.edits.push_back(*std::move(edit));
            paths.push_back(path);
            places.push_back(std::move(place));
        }
    }
    LayerDocs docs;
    const auto run = [&] {
        docs = into_.docs;
        NamespaceLog log = into_.log;
        OwnCreations creations;
        return execute(docs, log, creations, transaction, into_.revision + 1);
    };
    // Leaves an edit out that the other line refuses.
    const auto leaveOut = [&](std::uint32_t index, Error why) -> Result<void> {
        Edit& edit = transaction.edits[index];
        MergeConflict conflict;
        conflict.what = MergeConflict::What::Refused;
        conflict.layer = edit.layer;
        conflict.path = paths[index];
        conflict.reason = why.message;
        if (!leftOut.insert(index).second) return tl::unexpected(std::move(why));
        const Side side = decide(conflict);
        if (side == Side::From) return tl::unexpected(impossible(conflict));
        edit.address = OwnAddresses::unresolvable({kTransaction, index});
        if (leavesPlace(edit.action)) taken.emplace(edit.layer, places[index]);
        merged.conflicts.push_back(std::move(conflict));
        merged.decisions.push_back(side);
        return {};
    };
    const auto firstInTaken = [&]() -> std::optional<std::uint32_t> {
        for (std::uint32_t index = 0; index < transaction.edits.size(); ++index) {
            const Edit& edit = transaction.edits[index];
            if (std::holds_alternative<CreateSpec>(edit.action) && !leftOut.contains(index) &&
                taken.contains({edit.layer, places[index]}))
                return index;
        }
        return std::nullopt;
    };
    Outcome outcome;
    for (;;) {
        Result<void> left;
        if (const auto index = firstInTaken())
            left = leaveOut(*index, {ErrorCode::SpecExists, "the spec that was there stays"});
        else if (outcome = run(); const auto* refused = std::get_if<Refused>(&outcome))
            left = leaveOut(refused->edit, refused->error);
        else
            break;
        if (!left) return tl::unexpected(left.error());
    }
    const auto& executed = std::get<Executed>(outcome);
    for (const ExecutedEdit& one : executed.edits)
        if (one.applied.changed)
            merged.edits.push_back({one.edit.layer, one.edit.address.path, one.edit.action});
    merged.dropped = std::size_t(std::ranges::count_if(
        executed.dropped, [&](const DroppedEdit& one) { return !leftOut.contains(one.index); }));
    for (MergeConflict& one : again) {
        LayerDoc& doc = docs.at(one.layer);
        const LayerDoc& from = from_.docs.at(one.layer);
        const auto place = placeIn(doc, common_.at(one.layer), from, one.path);
        if (!place || doc.has(*place)) {
            one.reason = place ? "another spec is at its place" : "what it was in is deleted, too";
            return tl::unexpected(impossible(one));
        }
        for (auto& [at, action] : restoredSpecs(SpecTree(from, one.path), *place)) {
            if (auto applied = doc.apply(at, action); !applied)
                return tl::unexpected(applied.error());
            merged.edits.push_back({one.layer, at, std::move(action)});
        }
    }
    return merged;
}

}  // namespace usdlive::client
