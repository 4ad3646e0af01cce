// Executes transactions: translates addresses and the paths in values, drops or refuses edits, and
// applies the rest (M3-M7, M13, M15, M16).
#include "usdlive/common/layer/TransactionExecutor.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <unordered_set>

#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/FileRules.h"
#include "usdlive/common/layer/PathsInValues.h"

namespace usdlive {

namespace {

// The reason for not executing an edit. Either the edit is dropped or the whole transaction is
// refused.
struct Stop {
    enum class What { Drop, Refuse } what;
    Error error;
};
template <class T>
using Attempt = tl::expected<T, Stop>;

tl::unexpected<Stop> drop(ErrorCode code, std::string message) {
    return tl::unexpected(Stop{Stop::What::Drop, {code, std::move(message)}});
}
tl::unexpected<Stop> refuse(Error error) {
    return tl::unexpected(Stop{Stop::What::Refuse, std::move(error)});
}

bool isValueEdit(const EditAction& action) {
    return std::holds_alternative<SetField>(action) || std::holds_alternative<EraseField>(action);
}

constexpr std::string_view kTypeName = "typeName";

// Returns the field of an edit, or an empty text for an edit of the namespace.
std::string_view fieldOf(const EditAction& action) {
    if (const auto* set = std::get_if<SetField>(&action)) return set->field;
    if (const auto* erase = std::get_if<EraseField>(&action)) return erase->field;
    return {};
}

// Records what an executed edit has moved or deleted, or that it wrote paths.
void record(NamespaceLog& log, Revision revision, const ClientId& author, const Edit& edit,
            const LayerDoc::Applied& applied) {
    if (const auto* set = std::get_if<SetField>(&edit.action)) {
        if (applied.changed && mayHavePaths(edit.action))
            log.recordNaming(revision, edit.layer, edit.address.path, set->field,
                             NamespaceLog::authorOf(author));
    } else {
        recordMove(log, revision, author, edit);
    }
}

class Execution {
public:
    Execution(LayerDocs& layers, NamespaceLog& log, const OwnCreations& creations,
              const Transaction& transaction, Revision revision)
        : layers_(layers),
          log_(log),
          creations_(creations),
          transaction_(transaction),
          revision_(revision),
          firstMark_(log.mark()),
          resolver_(log, transaction.id.client, transaction.base,
                    [this](const Creation& creation) { return find(creation); }) {}

    Outcome run() {
        if (auto refused = checkAll()) return *std::move(refused);
        const std::uint64_t mark = log_.mark();
        const bool undoable = keepsCopies();
        for (std::uint32_t index = 0; index < transaction_.edits.size(); ++index) {
            const Edit& edit = transaction_.edits[index];
            if (undoable) copies_.try_emplace(edit.layer, layers_.find(edit.layer)->second);
            const auto done = executeEdit(edit, index);
            if (done) continue;
            if (done.error().what == Stop::What::Refuse) {
                for (auto& [layer, doc] : copies_) layers_[layer] = std::move(doc);
                log_.truncate(mark);
                return Refused{done.error().error, index};
            }
            executed_.dropped.push_back({index, done.error().error.code, edit});
            executed_.dropped.back().edit.names.clear();
        }
        moveUnderNewParents();
        correctUnseenPaths();
        eraseMisfits();
        return std::move(executed_);
    }

    // Records the paths of the created specs for later transactions of the author.
    void recordCreations(OwnCreations& creations) {
        for (auto& [index, entry] : created_)
            creations.record({transaction_.id.sequence, index}, std::move(entry), revision_);
    }

private:
    [[nodiscard]] std::optional<Refused> checkAll() const {
        if (transaction_.base < log_.oldest())
            return Refused{{ErrorCode::StaleBase, "revision " + std::to_string(transaction_.base) +
                                                      " is older than the recorded moves"},
                           0};
        if (transaction_.base >= revision_)
            return Refused{
                {ErrorCode::FutureRevision,
                 "revision " + std::to_string(transaction_.base) + " does not exist yet"},
                0};
        for (std::uint32_t index = 0; index < transaction_.edits.size(); ++index)
            if (auto checked = check(transaction_.edits[index]); !checked)
                return Refused{checked.error(), index};
        return std::nullopt;
    }

    // Makes all checks that do not need the layer, so that a transaction of values is not refused
    // after some of them are set.
    [[nodiscard]] Result<void> check(const Edit& edit) const {
        if (!layers_.contains(edit.layer))
            return fail(ErrorCode::LayerNotFound,
                        "there is no layer " + inQuotes(edit.layer.value));
        if (auto valid = checkPath(edit.address); !valid) return valid;
        for (const Address& name : edit.names)
            if (auto valid = checkPath(name); !valid && !name.path.empty()) return valid;
        if (const auto* move = std::get_if<MoveSpec>(&edit.action)) return checkPath(move->parent);
        const bool root = !edit.address.creation && edit.address.path == "/";
        if (const auto* set = std::get_if<SetField>(&edit.action))
            return checkAuthored(*set)
                .and_then([&] { return checkSet(root, *set); })
                .and_then([&] { return checkDictionary(*set); })
                .and_then([&] { return checkTexts(*set); });
        if (const auto* erase = std::get_if<EraseField>(&edit.action)) return checkErase(*erase);
        return {};
    }

    // A path relative to a creation is checked later, when the created spec is found.
    [[nodiscard]] static Result<void> checkPath(const Address& address) {
        if (address.creation) return {};
        return specpath::parse(address.path).map([](const auto&) {});
    }

    // Returns true if a refusal may have to restore layers. A single refused edit changes nothing,
    // and values at known paths have passed all checks. All other transactions need a copy.
    [[nodiscard]] bool keepsCopies() const {
        return transaction_.edits.size() > 1 &&
               std::any_of(transaction_.edits.begin(), transaction_.edits.end(),
                           [](const Edit& edit) {
                               return !isValueEdit(edit.action) || edit.address.creation ||
                                      fieldOf(edit.action) == kTypeName;
                           });
    }

    // ED8-ED10: refuses edits that no file can hold, drops edits for an attribute of another type,
    // and turns content without meaning into an erase.
    Attempt<void> applyFileRules(const Address& submitted, Edit& edit) {
        const std::string_view field = fieldOf(edit.action);
        if (field.empty()) return {};
        const LayerDoc& doc = layers_.find(edit.layer)->second;
        const std::string& path = edit.address.path;
        const auto kind = field == kTypeName ? doc.kind(path) : std::nullopt;
        if (kind)
            if (auto proper = checkTypeName(*kind, edit.action); !proper)
                return refuse(proper.error());
        if (auto* set = std::get_if<SetField>(&edit.action)) {
            const std::string_view type =
                dependsOnType(field) ? attributeType(doc, path) : std::string_view();
            if (!fitsType(type, *set) &&
                !fitsType(laterType(edit.layer, submitted).value_or(type), *set))
                return drop(ErrorCode::SpecKindConflict,
                            inQuotes(path) + " is of type " + inQuotes(type));
            if (std::holds_alternative<std::monostate>(set->part) && saysNothing(field, set->value))
                edit.action = EraseField{set->field, {}};
        } else if (const auto& erase = std::get<EraseField>(edit.action);
                   field == "variantSetNames" && std::holds_alternative<ListItem>(erase.part)) {
            const FieldValue* present = doc.field(path, field);
            if (!present || !holdsPart(*present, erase.part)) return {};
            FieldValue left = *present;
            if (erasePart(left, erase.part) && saysNothing(field, left))
                edit.action = EraseField{erase.field, {}};
        }
        return {};
    }

    // Returns the final type that this transaction gives the attribute, because edits of one spec
    // may come in any order.
    [[nodiscard]] std::optional<std::string_view> laterType(const LayerId& layer,
                                                            const Address& address) {
        if (!laterTypes_) {
            laterTypes_.emplace();
            for (const Edit& edit : transaction_.edits) {
                const auto* set = std::get_if<SetField>(&edit.action);
                const auto* name = set ? set->value.as<Value>() : nullptr;
                if (set && name && set->field == kTypeName)
                    (*laterTypes_)[{edit.layer, edit.address.path, edit.address.creation}] =
                        textOf(*name).value_or("");
            }
        }
        const auto found = laterTypes_->find({layer, address.path, address.creation});
        return found == laterTypes_->end() ? std::nullopt : std::optional(found->second);
    }

    // ED9: erases values that do not fit the new type of an attribute. Appends these edits, so that
    // the submitted ones keep their numbers.
    void eraseMisfits() {
        for (const auto& [layer, from] : retyped_) {
            const auto path = log_.translateFrom(layer, from.path, from.mark);
            if (!path) continue;
            LayerDoc& doc = layers_.find(layer)->second;
            for (const char* field : {"default", "spline", "timeSamples"}) {
                const FieldValue* content = doc.field(*path, field);
                if (!content || fitsType(attributeType(doc, *path), field, *content)) continue;
                ExecutedEdit done{{layer, {*path, {}}, EraseField{field, {}}}, {}};
                if (auto applied = doc.apply(*path, done.edit.action)) {
                    done.applied = *std::move(applied);
                    executed_.edits.push_back(std::move(done));
                }
            }
        }
    }

    // M13: the author created a spec that somebody else has created meanwhile. Sets the field to
    // the merged content of both, which the commit then contains. Returns the author's own value.
    std::optional<FieldValue> mergeWithExisting(const Address& submitted, Edit& edit) {
        auto* set = std::get_if<SetField>(&edit.action);
        if (merged_.empty() || !set || !std::holds_alternative<std::monostate>(set->part))
            return {};
        const LayerDoc& doc = layers_.find(edit.layer)->second;
        const FieldValue* present = doc.field(edit.address.path, set->field);
        if (!present || !merged_.contains({edit.layer, doc.idsAlong(edit.address.path).back()}))
            return {};
        // Editors create an `over` for each missing prim on the path of an edit.
        if (makesOver(*set)) return std::exchange(set->value, *present);
        if (!fitsType(laterType(edit.layer, submitted).value_or(std::string_view()), set->field,
                      *present))
            return {};
        FieldValue merged = unitedParts(set->field, *present, set->value);
        return std::exchange(set->value, std::move(merged));
    }

    Attempt<void> executeEdit(const Edit& edit, std::uint32_t index) {
        if (concernsPlace(edit.action)) return executePlaceEdit(edit, index);
        const bool creates = std::holds_alternative<CreateSpec>(edit.action);
        auto path = resolve(edit.layer, edit.address, creates);
        if (!path) return tl::unexpected(path.error());
        ExecutedEdit done{{edit.layer, {*std::move(path), {}}, edit.action}, {}};
        if (auto* move = std::get_if<MoveSpec>(&done.edit.action)) {
            auto parent = resolve(edit.layer, move->parent);
            if (!parent) return tl::unexpected(parent.error());
            move->parent = {*std::move(parent), {}};
        }
        if (auto named = resolveNames(edit, done.edit.action); !named) return named;
        if (auto proper = applyFileRules(edit.address, done.edit); !proper) return proper;
        auto unmerged = mergeWithExisting(edit.address, done.edit);
        auto applied =
            layers_.find(edit.layer)
                ->second.apply(done.edit.address.path, done.edit.action, LayerDoc::By::Author);
        if (!applied) return tl::unexpected(stopFor(edit, applied.error()));
        done.applied = *std::move(applied);
        record(log_, revision_, transaction_.id.client, done.edit, done.applied);
        if (creates)
            created_[index] = {edit.layer, done.edit.address.path, log_.mark(),
                               resolver_.before(edit.layer, edit.address)};
        if (done.applied.changed && fieldOf(edit.action) == kTypeName)
            retyped_.push_back({edit.layer, {done.edit.address.path, log_.mark()}});
        if (creates && !done.applied.changed) merged_.insert({edit.layer, done.applied.node});
        if (unmerged) executed_.unmerged.emplace(executed_.edits.size(), *std::move(unmerged));
        executed_.edits.push_back(std::move(done));
        return {};
    }

    // M15: a move or delete of what is at a place. It is never dropped, because later addresses may
    // name the place that it leaves. Has no effect if somebody has deleted the object, or the new
    // parent.
    Attempt<void> executePlaceEdit(const Edit& edit, std::uint32_t index) {
        auto from = resolve(edit.layer, edit.address, true);
        const bool isKnown = from || from.error().what == Stop::What::Drop;
        if (!isKnown) return tl::unexpected(from.error());
        if (from && *from == "/")
            return refuse({ErrorCode::InvalidEdit, "the pseudo-root has no place"});
        ExecutedEdit done{{edit.layer, {}, edit.action}, {}};
        auto* move = std::get_if<MoveSpec>(&done.edit.action);
        auto parent = move ? resolve(edit.layer, move->parent) : Attempt<std::string>("/");
        if (!parent && parent.error().what == Stop::What::Refuse)
            return tl::unexpected(parent.error());
        if (!from || !parent) {
            std::string left =
                from ? *std::move(from) : resolver_.vacated(edit.layer, edit.address);
            done.edit.action = stayingAt(left);
            done.edit.address.path = left;
            created_[index] = {edit.layer, std::move(left), log_.mark()};
            executed_.edits.push_back(std::move(done));
            return {};
        }
        done.edit.address.path = *std::move(from);
        if (move) move->parent = {*std::move(parent), {}};
        const std::string& path = done.edit.address.path;
        auto applied =
            layers_.find(edit.layer)->second.apply(path, done.edit.action, LayerDoc::By::Author);
        if (!applied) return tl::unexpected(stopFor(edit, applied.error()));
        done.applied = *std::move(applied);
        if (move && done.applied.node != 0 && !done.applied.changed) {  // something is in its way
            withoutParent_.emplace_back(index, done.edit);
            done.edit.action = stayingAt(path);
        }
        record(log_, revision_, transaction_.id.client, done.edit, done.applied);
        created_[index] = {edit.layer, path, log_.mark()};
        executed_.edits.push_back(std::move(done));
        return {};
    }

    // A colleague gave the moved object its first opinion in a layer that has nothing at the new
    // parent. Creates it there, after all edits, so that the submitted ones keep their numbers. The
    // last edit of the object decides.
    void moveUnderNewParents() {
        std::map<std::pair<LayerId, std::string>, std::vector<std::uint32_t>> numbers;
        for (const auto& [index, edit] : withoutParent_)
            numbers[{edit.layer, edit.address.path}].push_back(index);
        for (const auto& [index, edit] : withoutParent_) {
            const auto& ofObject = numbers.at({edit.layer, edit.address.path});
            if (ofObject.back() != index) continue;
            const auto& move = std::get<MoveSpec>(edit.action);
            LayerDoc& doc = layers_.find(edit.layer)->second;
            if (!doc.has(edit.address.path) || doc.has(destination(edit.address.path, move)))
                continue;
            std::vector<std::string> missing;
            for (std::string at = move.parent.path; !doc.has(at); at = specpath::parent(at))
                missing.push_back(at);
            for (; !missing.empty(); missing.pop_back()) {
                if (!append(doc, {edit.layer, {missing.back(), {}}, CreateSpec{SpecKind::Prim}}))
                    return;
                const Value over(ValueType::Specifier, Bytes{1});
                (void)append(doc, {edit.layer,
                                   {missing.back(), {}},
                                   SetField{"specifier", {}, over, ValueType::None}});
            }
            if (!append(doc, edit)) continue;
            for (const std::uint32_t number : ofObject) created_.at(number).mark = log_.mark();
        }
    }

    // Executes an edit that is not the author's. Returns whether it changed something.
    bool append(LayerDoc& doc, Edit edit) {
        auto applied = doc.apply(edit.address.path, edit.action);
        if (!applied || !applied->changed) return false;
        record(log_, revision_, transaction_.id.client, edit, *applied);
        executed_.edits.push_back({std::move(edit), *std::move(applied)});
        return true;
    }

    // M16: the paths that others have written to a place from which this transaction moved or
    // deleted the object, and that its author had not seen.
    void correctUnseenPaths() {
        const Revision seen = newestSeen(transaction_);
        if (seen + 1 >= revision_) return;
        std::set<LayerId> layers;
        for (const auto& [index, entry] : created_)
            if (concernsPlace(transaction_.edits[index].action)) layers.insert(entry.layer);
        for (const LayerId& layer : layers) correctUnseenPaths(layer, seen);
    }

    void correctUnseenPaths(const LayerId& layer, Revision seen) {
        LayerDoc& doc = layers_.find(layer)->second;
        std::set<std::pair<std::string, std::string>> named;
        const auto note = [&](std::string path, const std::string& field) {
            named.emplace(std::move(path), field);
        };
        const auto author = NamespaceLog::authorOf(transaction_.id.client);
        if (!log_.forEachNaming(layer, seen, author, note))
            doc.visit([&](const LayerDoc::SpecView& spec) {
                for (const auto& [field, content] : *spec.fields)
                    if (mayHavePaths(content)) named.emplace(std::string(spec.path), field);
            });
        const PathChange change = [&](std::string_view path, PathRole role) {
            return carried(log_, layer, path, firstMark_, role);
        };
        for (const auto& [path, field] : named) {
            const FieldValue* present = doc.field(path, field);
            if (!present) continue;
            FieldValue now = *present;
            // An explicit list without items is an opinion, too.
            const auto* list = now.as<ListOp>();
            const bool left = changePaths(now, change) || (list && list->isExplicit);
            if (now == *present && left) continue;
            for (EditAction& action : left ? authoredParts(field, present, &now)
                                           : std::vector<EditAction>{EraseField{field, {}}})
                (void)append(doc, {layer, {path, {}}, std::move(action)});
        }
    }

    // M15: carries the paths in the values of an edit to the present, as addresses.
    Attempt<void> resolveNames(const Edit& edit, EditAction& action) {
        if (!isValueEdit(action)) return {};
        const bool isSimple = edit.names.empty();
        if (isSimple && resolver_.baseMark() == log_.mark()) return {};
        if (!mayHavePaths(action)) return {};
        std::size_t number = 0;
        const auto now = [&](std::string_view path, PathRole role) -> std::optional<std::string> {
            const Address name = isSimple                     ? Address{std::string(path), {}}
                                 : number < edit.names.size() ? edit.names[number]
                                                              : Address{};
            ++number;
            return resolver_.named(edit.layer, name, path, role);
        };
        if (changePaths(action, now)) return {};
        return drop(ErrorCode::SpecDeleted, "what the value names has been deleted");
    }

    static Stop stopFor(const Edit& edit, const Error& error) {
        // The path was valid when it was checked. Its parents were moved, and now it is too long
        // for any spec.
        const bool tooLong = error.code == ErrorCode::InvalidPath &&
                             !std::holds_alternative<CreateSpec>(edit.action) &&
                             !std::holds_alternative<MoveSpec>(edit.action);
        if (error.code == ErrorCode::SpecNotFound || tooLong)
            return {Stop::What::Drop, {ErrorCode::SpecNotFound, error.message}};
        // ED7: the edit was meant for another spec with this name.
        if (error.code == ErrorCode::SpecKindConflict && isValueEdit(edit.action))
            return {Stop::What::Drop, error};
        return {Stop::What::Refuse, error};
    }

    [[nodiscard]] const OwnCreations::Entry* find(const Creation& creation) const {
        if (creation.sequence != transaction_.id.sequence) return creations_.find(creation);
        const auto found = created_.find(creation.edit);
        return found == created_.end() ? nullptr : &found->second;
    }

    // Returns the path of an edit, or of the new parent of a move.
    [[nodiscard]] Attempt<std::string> resolve(const LayerId& layer, const Address& address,
                                               bool isPlace = false) const {
        auto path = isPlace ? resolver_.place(layer, address) : resolver_.spec(layer, address);
        if (path) return *std::move(path);
        const auto what =
            path.error().code == ErrorCode::SpecDeleted ? Stop::What::Drop : Stop::What::Refuse;
        return tl::unexpected(Stop{what, std::move(path.error())});
    }

    LayerDocs& layers_;
    NamespaceLog& log_;
    const OwnCreations& creations_;
    const Transaction& transaction_;
    Revision revision_;
    std::uint64_t firstMark_;  // the first entry of this transaction
    AddressResolver resolver_;

    Executed executed_;
    // Created specs and vacated places, by this transaction's edits.
    std::map<std::uint32_t, OwnCreations::Entry> created_;
    // Moves of places that had no effect, with their numbers.
    std::vector<std::pair<std::uint32_t, Edit>> withoutParent_;
    LayerDocs copies_;  // the layers before the transaction
    // Specs that existed already when a Create was executed (M2).
    std::set<std::pair<LayerId, NodeId>> merged_;
    std::vector<std::pair<LayerId, PlaceBefore>> retyped_;  // specs with a new type name
    using Register = std::tuple<LayerId, std::string_view, std::optional<Creation>>;
    std::optional<std::map<Register, std::string_view>> laterTypes_;
};

}  // namespace

void recordMove(NamespaceLog& log, Revision revision, const ClientId& author,
                const Edit& executed) {
    if (!changesNamespace(executed)) return;
    const auto what =
        concernsPlace(executed.action) ? NamespaceLog::Of::Place : NamespaceLog::Of::Spec;
    const auto number = NamespaceLog::authorOf(author);
    const std::string& path = executed.address.path;
    if (const auto* move = std::get_if<MoveSpec>(&executed.action))
        log.recordMove(revision, executed.layer, path, destination(path, *move), what, number);
    else
        log.recordDelete(revision, executed.layer, path, what, number);
}

Outcome execute(LayerDocs& layers, NamespaceLog& log, OwnCreations& creations,
                const Transaction& transaction, Revision revision) {
    Execution execution(layers, log, creations, transaction, revision);
    Outcome outcome = execution.run();
    if (std::holds_alternative<Executed>(outcome)) {
        execution.recordCreations(creations);
    }
    return outcome;
}

Result<Executed> executeInOrder(LayerDocs& layers, NamespaceLog& log, std::vector<Edit> edits,
                                Revision revision) {
    LayerDocs before;
    const std::uint64_t mark = log.mark();
    const auto undone = [&](Error error) {
        for (auto& [id, doc] : before) layers[id] = std::move(doc);
        log.truncate(mark);
        return tl::unexpected(std::move(error));
    };
    Executed executed;
    for (Edit& edit : edits) {
        const auto layer = layers.find(edit.layer);
        if (layer == layers.end())
            return undone({ErrorCode::LayerNotFound, "there is no layer " + edit.layer.value});
        before.try_emplace(layer->first, layer->second);
        auto applied = layer->second.apply(edit.address.path, edit.action);
        if (!applied) return undone(applied.error());
        record(log, revision, {}, edit, *applied);
        executed.edits.push_back({std::move(edit), std::move(*applied)});
    }
    return executed;
}

Result<void> applyCommit(LayerDocs& layers, NamespaceLog& log, const Commit& commit,
                         AppliedEdits* observer) {
    Result<void> result;
    std::unordered_set<LayerId> diverged;
    auto layer = layers.end();
    const LayerId* found = nullptr;  // the last layer found: most edits are of the same one
    for (const Edit& edit : commit.edits) {
        if (!found || *found != edit.layer) layer = layers.find(*(found = &edit.layer));
        if (layer == layers.end()) continue;
        if (!diverged.empty() && diverged.contains(edit.layer)) continue;
        if (observer) observer->before(layer->second, edit);
        const auto applied = layer->second.apply(edit.address.path, edit.action);
        if (applied) {
            if (observer) observer->after(layer->second, edit);
            record(log, commit.revision, commit.id.client, edit, *applied);
            continue;
        }
        diverged.insert(edit.layer);
        if (result)
            result = fail(applied.error().code,
                          "layer " + inQuotes(edit.layer.value) + " has diverged at revision " +
                              std::to_string(commit.revision) + ": " + applied.error().message);
    }
    return result;
}

void forEachExecuted(
    const NamespaceLog& log, const Commit& commit,
    const std::function<void(const Edit& edit, std::uint32_t index, std::uint64_t mark)>& visit) {
    std::uint64_t mark = log.markAfter(commit.revision - 1);
    SubmittedIndexes indexes(commit.dropped);
    for (const Edit& edit : commit.edits) {
        if (log.isEntry(mark, edit)) ++mark;
        visit(edit, indexes.next(), mark);
    }
}

std::map<std::uint32_t, OwnCreations::Entry> createdBy(const NamespaceLog& log,
                                                       const Commit& commit) {
    std::map<std::uint32_t, OwnCreations::Entry> created;
    // The edits of objects that did not move.
    std::map<std::pair<LayerId, std::string>, std::vector<std::uint32_t>> staying;
    forEachExecuted(log, commit, [&](const Edit& edit, std::uint32_t index, std::uint64_t mark) {
        const bool ofPlace = concernsPlace(edit.action);
        if (ofPlace || std::holds_alternative<CreateSpec>(edit.action))
            created.emplace(index, OwnCreations::Entry{edit.layer, edit.address.path, mark});
        if (ofPlace && !changesNamespace(edit))
            staying[{edit.layer, edit.address.path}].push_back(index);
        else if (ofPlace && !staying.empty())  // moved under a new parent, after all others
            if (const auto stayed = staying.find({edit.layer, edit.address.path});
                stayed != staying.end())
                for (const std::uint32_t one : stayed->second) created.at(one).mark = mark;
    });
    return created;
}

void recordCreations(OwnCreations& creations, const NamespaceLog& log, const Transaction& submitted,
                     const Commit& commit) {
    auto created = createdBy(log, commit);
    created.erase(created.lower_bound(std::uint32_t(submitted.edits.size())), created.end());
    const AddressResolver resolver(log, submitted.id.client, submitted.base,
                                   [&](const Creation& creation) -> const OwnCreations::Entry* {
                                       if (creation.sequence != submitted.id.sequence)
                                           return creations.find(creation);
                                       const auto found = created.find(creation.edit);
                                       return found == created.end() ? nullptr : &found->second;
                                   });
    for (auto& [index, entry] : created) {
        const Edit& edit = submitted.edits[index];
        if (std::holds_alternative<CreateSpec>(edit.action))
            entry.place = resolver.before(edit.layer, edit.address);
    }
    for (auto& [index, entry] : created)
        creations.record({submitted.id.sequence, index}, std::move(entry), commit.revision);
}

}  // namespace usdlive
