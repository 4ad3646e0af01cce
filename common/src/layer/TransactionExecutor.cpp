// Executes transactions: translates addresses, drops or refuses edits, and applies the rest (M3-M7,
// M13).
#include "usdlive/common/layer/TransactionExecutor.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <unordered_set>

#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/FileRules.h"

namespace usdlive {

std::string relativePath(std::string_view path, std::string_view created) {
    if (path == created) return {};
    if (created.ends_with("=}")) return std::string(path.substr(created.rfind('{')));
    return std::string(path.substr(created.size()));
}

std::optional<std::string> absolutePath(std::string_view relative, std::string_view created) {
    if (relative.empty()) return std::string(created);
    if (created.ends_with("=}")) {
        const std::size_t equals = relative.find('=');
        if (!relative.starts_with('{') || equals == std::string_view::npos) return std::nullopt;
        return std::string(created.substr(0, created.size() - 1))
            .append(relative.substr(equals + 1));
    }
    const bool afterVariant = created.ends_with('}');
    const bool separated = std::string_view("/.{").find(relative.front()) != std::string_view::npos;
    if (afterVariant && relative.starts_with('/')) relative.remove_prefix(1);
    if (!afterVariant && !separated) return std::nullopt;
    return std::string(created).append(relative);
}

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

// Records the moves and deletes of an executed edit.
void record(NamespaceLog& log, Revision revision, const Edit& edit) {
    if (std::holds_alternative<DeleteSpec>(edit.action))
        log.recordDelete(revision, edit.layer, edit.address.path);
    else if (const auto* move = std::get_if<MoveSpec>(&edit.action))
        log.recordMove(
            revision, edit.layer, edit.address.path,
            specpath::child(move->parent.path, specpath::last(edit.address.path).list, move->name));
}

class Execution {
public:
    Execution(LayerDocs& layers, NamespaceLog& log, const OwnCreations& creations,
              const Transaction& transaction, Revision revision)
        : layers_(layers),
          log_(log),
          creations_(creations),
          transaction_(transaction),
          revision_(revision) {}

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
        }
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
        for (const auto& [layer, from, mark] : retyped_) {
            const auto path = log_.translateFrom(layer, from, mark);
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
    // the merged content of both, which the commit then contains.
    void mergeWithExisting(const Address& submitted, Edit& edit) {
        auto* set = std::get_if<SetField>(&edit.action);
        if (merged_.empty() || !set || !std::holds_alternative<std::monostate>(set->part)) return;
        const LayerDoc& doc = layers_.find(edit.layer)->second;
        const FieldValue* present = doc.field(edit.address.path, set->field);
        if (!present || !merged_.contains({edit.layer, doc.idsAlong(edit.address.path).back()}))
            return;
        // Editors create an `over` for each missing prim on the path of an edit.
        if (makesOver(*set))
            set->value = *present;
        else if (fitsType(laterType(edit.layer, submitted).value_or(std::string_view()), set->field,
                          *present))
            set->value = unitedParts(set->field, *present, set->value);
    }

    Attempt<void> executeEdit(const Edit& edit, std::uint32_t index) {
        const bool creates = std::holds_alternative<CreateSpec>(edit.action);
        auto path =
            creates ? resolvePlace(edit.layer, edit.address) : resolve(edit.layer, edit.address);
        if (!path) return tl::unexpected(path.error());
        ExecutedEdit done{{edit.layer, {*std::move(path), {}}, edit.action}, {}};
        if (auto* move = std::get_if<MoveSpec>(&done.edit.action)) {
            auto parent = resolve(edit.layer, move->parent);
            if (!parent) return tl::unexpected(parent.error());
            move->parent = {*std::move(parent), {}};
        }
        if (auto proper = applyFileRules(edit.address, done.edit); !proper) return proper;
        mergeWithExisting(edit.address, done.edit);
        auto applied =
            layers_.find(edit.layer)
                ->second.apply(done.edit.address.path, done.edit.action, LayerDoc::By::Author);
        if (!applied) return tl::unexpected(stopFor(edit, applied.error()));
        done.applied = *std::move(applied);
        if (done.applied.changed) record(log_, revision_, done.edit);
        if (creates) created_[index] = {edit.layer, done.edit.address.path, log_.mark()};
        if (done.applied.changed && fieldOf(edit.action) == kTypeName)
            retyped_.push_back({edit.layer, done.edit.address.path, log_.mark()});
        if (creates && !done.applied.changed) merged_.insert({edit.layer, done.applied.node});
        executed_.edits.push_back(std::move(done));
        return {};
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

    // A path and the log entry from which it is translated.
    struct Origin {
        std::string path;
        std::optional<std::uint64_t> mark;  // nothing: from the base revision on
    };

    [[nodiscard]] Attempt<Origin> origin(const LayerId& layer, const Address& address) const {
        if (!address.creation) return Origin{address.path, {}};
        const OwnCreations::Entry* entry = find(*address.creation);
        if (!entry) return drop(ErrorCode::SpecDeleted, "the spec of the edit was never created");
        if (entry->layer != layer)
            return refuse({ErrorCode::InvalidEdit,
                           "the spec of the edit was created in " + inQuotes(entry->layer.value)});
        auto path = absolutePath(address.path, entry->path);
        if (!path)
            return refuse({ErrorCode::InvalidPath,
                           inQuotes(address.path) + " cannot follow " + inQuotes(entry->path)});
        if (const auto valid = specpath::parse(*path); !valid) return refuse(valid.error());
        return Origin{*std::move(path), entry->mark};
    }

    [[nodiscard]] const OwnCreations::Entry* find(const Creation& creation) const {
        if (creation.sequence != transaction_.id.sequence) return creations_.find(creation);
        const auto found = created_.find(creation.edit);
        return found == created_.end() ? nullptr : &found->second;
    }

    [[nodiscard]] Attempt<std::string> carryForward(const LayerId& layer, Origin origin) const {
        auto path = origin.mark ? log_.translateFrom(layer, origin.path, *origin.mark)
                                : log_.translate(layer, origin.path, transaction_.base);
        if (!path) return drop(ErrorCode::SpecDeleted, inQuotes(origin.path) + " has been deleted");
        return *std::move(path);
    }

    [[nodiscard]] Attempt<std::string> resolve(const LayerId& layer, const Address& address) const {
        auto from = origin(layer, address);
        if (!from) return tl::unexpected(from.error());
        return carryForward(layer, *std::move(from));
    }

    // For a spec to be created, only its parent can have moved. An earlier spec with the same path
    // that was moved or deleted is another spec.
    [[nodiscard]] Attempt<std::string> resolvePlace(const LayerId& layer,
                                                    const Address& address) const {
        auto from = origin(layer, address);
        if (!from) return tl::unexpected(from.error());
        if (from->path == "/") return from->path;  // apply() reports the error
        const auto parent = carryForward(layer, {specpath::parent(from->path), from->mark});
        if (!parent) return tl::unexpected(parent.error());
        const PathElement last = specpath::last(from->path);
        return specpath::child(*parent, last.list, last.name);
    }

    LayerDocs& layers_;
    NamespaceLog& log_;
    const OwnCreations& creations_;
    const Transaction& transaction_;
    Revision revision_;

    Executed executed_;
    std::map<std::uint32_t, OwnCreations::Entry> created_;  // by this transaction's edits
    LayerDocs copies_;                                      // the layers before the transaction
    // Specs that existed already when a Create was executed (M2).
    std::set<std::pair<LayerId, NodeId>> merged_;
    std::vector<OwnCreations::Entry> retyped_;  // specs with a new type name
    using Register = std::tuple<LayerId, std::string_view, std::optional<Creation>>;
    std::optional<std::map<Register, std::string_view>> laterTypes_;
};

}  // namespace

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
        if (applied->changed) record(log, revision, edit);
        executed.edits.push_back({std::move(edit), std::move(*applied)});
    }
    return executed;
}

Result<void> applyCommit(LayerDocs& layers, NamespaceLog& log, const Commit& commit) {
    Result<void> result;
    std::unordered_set<LayerId> diverged;
    auto layer = layers.end();
    const LayerId* found = nullptr;  // the last layer found: most edits are of the same one
    for (const Edit& edit : commit.edits) {
        if (!found || *found != edit.layer) layer = layers.find(*(found = &edit.layer));
        if (layer == layers.end()) continue;
        if (!diverged.empty() && diverged.contains(edit.layer)) continue;
        const auto applied = layer->second.apply(edit.address.path, edit.action);
        if (applied) {
            if (applied->changed) record(log, commit.revision, edit);
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

void recordCreations(OwnCreations& creations, NamespaceLog& log, const Transaction& submitted,
                     const Commit& commit) {
    struct Created {
        std::uint32_t index;
        const Edit* edit;
        std::uint64_t mark;
    };
    NamespaceLog own;  // the moves and deletes of the commit, numbered from 0
    std::vector<Created> created;
    auto dropped = commit.dropped.begin();
    auto executed = commit.edits.begin();
    for (std::uint32_t index = 0; index < submitted.edits.size(); ++index) {
        if (dropped != commit.dropped.end() && dropped->index == index) {
            ++dropped;
            continue;
        }
        if (executed == commit.edits.end()) break;
        if (std::holds_alternative<CreateSpec>(executed->action))
            created.push_back({index, &*executed, own.mark()});
        record(own, commit.revision, *executed);
        ++executed;
    }
    for (const Created& item : created) {
        const LayerId& layer = item.edit->layer;
        auto path = own.translateFrom(layer, item.edit->address.path, item.mark);
        if (path)
            creations.record({submitted.id.sequence, item.index},
                             {layer, *std::move(path), log.mark()}, commit.revision);
    }
}

}  // namespace usdlive
