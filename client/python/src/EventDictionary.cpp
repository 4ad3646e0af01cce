// Converts events to Python dictionaries.
#include "EventDictionary.h"

#include <nlohmann/json.hpp>
#include <string>
#include <variant>

#include "Fields.h"
#include "cli/Json.h"
#include "usdlive/common/core/UserColour.h"
#include "usdlive/common/layer/NoBlobs.h"

namespace nb = nanobind;

namespace usdlive {
namespace {

nb::str text(std::string_view value) { return nb::str(value.data(), value.size()); }

nb::dict make(const char* name) {
    nb::dict dictionary;
    dictionary["event"] = name;
    return dictionary;
}

void put(nb::dict& dictionary, const Error& reason) {
    dictionary["code"] = text(errorName(reason.code));
    dictionary["message"] = text(reason.message);
}

const char* actionName(const EditAction& action) {
    constexpr const char* names[] = {"create", "delete", "move", "place", "set", "erase"};
    return names[action.index()];
}

/// Returns the edited part of a field, or None for the whole field.
nb::object part(const FieldPart& part) {
    if (const auto* key = std::get_if<DictionaryKey>(&part)) {
        std::string joined;
        for (const std::string& step : key->path) joined += (joined.empty() ? "" : ":") + step;
        return text(joined);
    }
    if (const auto* sample = std::get_if<SampleTime>(&part)) return nb::float_(sample->time);
    if (const auto* item = std::get_if<ListItem>(&part))
        return text(textOf(itemKey(item->item)).value_or("item"));
    if (const auto* key = std::get_if<MapKey>(&part)) return text(textOf(key->key).value_or("key"));
    return nb::none();
}

nb::dict toDictionary(const LayerId& layer, const std::string& path, const EditAction& action) {
    nb::dict edit;
    edit["kind"] = actionName(action);
    edit["layer"] = text(layer.value);
    edit["path"] = text(path);
    if (const auto* set = std::get_if<SetField>(&action)) {
        edit["field"] = text(set->field);
        edit["part"] = part(set->part);
    } else if (const auto* erase = std::get_if<EraseField>(&action)) {
        edit["field"] = text(erase->field);
        edit["part"] = part(erase->part);
    } else if (const auto* move = std::get_if<MoveSpec>(&action)) {
        const auto list = specpath::last(path).list;
        edit["new_path"] = text(specpath::child(move->parent.path, list, move->name));
    }
    return edit;
}

/// Returns the content as JSON text, or None.
nb::object json(const std::optional<FieldValue>& value) {
    NoBlobs none;
    return value ? nb::object(text(cli::line(cli::toJson(*value, none)))) : nb::none();
}

nb::list strings(const std::vector<LayerId>& layers) {
    nb::list list;
    for (const LayerId& layer : layers) list.append(text(layer.value));
    return list;
}

nb::dict convert(const client::event::Connected& event) {
    nb::dict d = make("Connected");
    d["project"] = text(event.welcome.project);
    d["epoch"] = event.welcome.epoch;
    d["revision"] = event.welcome.revision;
    d["resumed"] = event.resumed;
    d["store"] = text(event.welcome.store.value_or(StoreId{}).value);
    d["left_history"] = event.leftHistory;
    return d;
}

nb::dict convert(const client::event::Disconnected& event) {
    nb::dict d = make("Disconnected");
    put(d, event.reason);
    return d;
}

nb::dict convert(const client::event::LayersChanged& event) {
    nb::dict d = make("LayersChanged");
    d["added"] = strings(event.added);
    d["removed"] = strings(event.removed);
    return d;
}

nb::dict convert(const client::event::FilesChanged& event) {
    nb::dict d = make("FilesChanged");
    nb::list files;
    for (const std::string& file : event.files) files.append(text(file));
    d["files"] = files;
    return d;
}

nb::dict convert(const client::event::PathOutside& event) {
    nb::dict d = make("PathOutside");
    d["layer"] = text(event.layer.value);
    d["prim"] = text(event.prim);
    d["property"] = text(event.property);
    d["path"] = text(event.path);
    return d;
}

nb::dict convert(const client::event::Joining& event) {
    nb::dict d = make("Joining");
    d["layer"] = text(event.progress.layer.value);
    d["specs"] = event.progress.specs;
    d["specs_total"] = event.progress.specsTotal;
    return d;
}

nb::dict convert(const client::event::Joined& event) {
    nb::dict d = make("Joined");
    d["layer"] = text(event.layer.value);
    d["revision"] = event.revision;
    return d;
}

nb::dict convert(const client::event::JoinFailed& event) {
    nb::dict d = make("JoinFailed");
    d["layer"] = text(event.layer.value);
    put(d, event.reason);
    return d;
}

nb::dict convert(const client::event::LayerOpened& event) {
    nb::dict d = make("LayerOpened");
    d["request"] = event.request;
    d["layer"] = text(event.layer.value);
    return d;
}

nb::dict convert(const client::event::LayerOpenFailed& event) {
    nb::dict d = make("LayerOpenFailed");
    d["request"] = event.request;
    d["layer"] = text(event.layer.value);
    put(d, event.reason);
    return d;
}

nb::dict convert(const client::event::Uploaded& event) {
    nb::dict d = make("Uploaded");
    d["request"] = event.request;
    d["path"] = text(event.path);
    return d;
}

nb::dict convert(const client::event::UploadFailed& event) {
    nb::dict d = make("UploadFailed");
    d["request"] = event.request;
    d["path"] = text(event.path);
    put(d, event.reason);
    return d;
}

// Sets who has made a commit, and when, and its edits.
void put(nb::dict& d, const Commit& commit) {
    d["user"] = text(commit.user.value);
    d["client"] = text(commit.id.client.value);
    d["time"] = double(commit.timeMs) / 1000.0;
    d["label"] = text(commit.label);
    nb::list edits;
    for (const Edit& edit : commit.edits)
        edits.append(toDictionary(edit.layer, edit.address.path, edit.action));
    d["edits"] = edits;
}

nb::dict convert(const client::event::Committed& event) {
    const Commit& commit = event.commit;
    nb::dict d = make("Committed");
    d["revision"] = commit.revision;
    d["conflated"] = commit.conflated;
    d["missed"] = event.missed;
    put(d, commit);
    return d;
}

nb::dict convert(const client::event::Lost& event) {
    nb::dict d = make("Lost");
    put(d, event.work.reason);
    d["index"] = event.index;
    d["count"] = event.count;
    d["refused"] = event.work.refused;
    nb::list edits;
    for (const client::AuthoredEdit& edit : event.work.edits)
        edits.append(toDictionary(edit.layer, edit.path, edit.action));
    d["edits"] = edits;
    return d;
}

nb::dict convert(const client::event::PreviewChanged& event) {
    nb::dict d = make("PreviewChanged");
    d["client"] = text(event.author.value);
    d["gesture"] = event.gesture;
    d["withdrawn"] = event.withdrawn;
    return d;
}

/// "event" is the type of the answer, as in "checkpointCreated".
template <class Request>
nb::dict convert(const client::event::Answered<Request>& event) {
    nb::dict d = make(std::string(event.answer.kType).c_str());
    putFields(d, event.answer);
    return d;
}

nb::dict convert(const client::event::Progress& event) {
    constexpr const char* names[] = {"import", "save", "upload", "fetch", "open"};
    nb::dict d = make("Progress");
    d["task"] = names[int(event.task)];
    d["layer"] = text(event.layer.value);
    d["done"] = event.done;
    d["total"] = event.total;
    d["request"] = event.request;
    return d;
}

nb::dict convert(const client::event::ServerError& event) {
    nb::dict d = make("ServerError");
    d["request"] = event.message.request ? nb::object(nb::int_(*event.message.request))
                                         : nb::object(nb::none());
    d["code"] = text(event.message.code);
    d["message"] = text(event.message.message);
    return d;
}

nb::dict convert(const client::event::LayerStatesChanged& event) {
    nb::dict d = make("LayerStatesChanged");
    nb::list layers;
    for (const LayerState& state : event.layers) layers.append(toDictionary(state));
    d["layers"] = layers;
    return d;
}

nb::dict convert(const client::event::RightsChanged&) { return make("RightsChanged"); }

nb::dict convert(const client::event::PresenceChanged& event) {
    nb::dict d = make("PresenceChanged");
    nb::list shown, gone;
    for (const Presence& presence : event.shown) shown.append(toDictionary(presence));
    for (const ClientId& client : event.gone) gone.append(text(client.value));
    d["shown"] = shown;
    d["gone"] = gone;
    return d;
}

nb::dict convert(const client::event::UnsentFound& event) {
    nb::dict d = make("UnsentFound");
    nb::list work;
    for (const client::UnsentWork& one : event.work) work.append(usdlive::toDictionary(one));
    d["work"] = work;
    return d;
}

}  // namespace

nb::dict toDictionary(const client::UnsentWork& work) {
    nb::dict d;
    d["id"] = text(work.client.value);
    d["time"] = double(work.timeMs) / 1000.0;
    d["transactions"] = work.transactions;
    d["edits"] = work.edits;
    nb::list layers;
    for (const LayerId& layer : work.layers) layers.append(text(layer.value));
    d["layers"] = nb::tuple(layers);
    d["file"] = text(work.file);
    d["other_project"] = work.otherProject;
    return d;
}

nb::dict toDictionary(const client::OtherHistory& other) {
    nb::dict d;
    d["expected_project"] = text(other.expectedProject);
    d["expected_store"] = text(other.expectedStore.value);
    d["found_project"] = text(other.foundProject);
    d["found_store"] = text(other.foundStore.value);
    d["other_project"] = other.isOtherProject();
    d["message"] = text(other.reason.message);
    return d;
}

nb::dict toDictionary(const Commit& commit) {
    nb::dict d;
    d["revision"] = commit.revision;
    put(d, commit);
    d["imported"] = commit.imported ? nb::object(text(commit.imported->value)) : nb::none();
    return d;
}

nb::dict toDictionary(const client::BlamedContent& one) {
    nb::dict d;
    d["path"] = text(one.made.path);
    d["field"] = one.made.field.empty() ? nb::object(nb::none()) : text(one.made.field);
    d["part"] = part(one.made.part);
    d["revision"] = one.made.revision;
    d["user"] = text(one.made.user.value);
    d["time"] = double(one.made.timeMs) / 1000.0;
    d["imported"] = one.made.isImport;
    d["value"] = json(one.content);
    d["before"] = json(one.prior);
    d["before_known"] = one.isPriorKnown;
    return d;
}

nb::dict toDictionary(const client::SessionInfo& session) {
    nb::dict d;
    d["name"] = text(session.name);
    d["address"] = text(session.address);
    d["creator"] = text(session.creator.value);
    d["time"] = double(session.timeMs) / 1000.0;
    d["revision"] = session.revision;
    d["ended"] = session.isEnded;
    d["merged"] = session.merged;
    d["problem"] = text(session.problem);
    nb::list users;
    for (const UserName& user : session.users) users.append(text(user.value));
    d["users"] = nb::tuple(users);
    return d;
}

nb::dict toDictionary(const client::SessionConflict& conflict) {
    constexpr const char* kWhat[] = {"value", "deleted", "moved", "refused"};
    nb::dict d;
    d["what"] = kWhat[std::size_t(conflict.what)];
    d["layer"] = text(conflict.layer.value);
    d["path"] = text(conflict.path);
    d["field"] = conflict.field.empty() ? nb::object(nb::none()) : text(conflict.field);
    d["part"] = part(conflict.part);
    d["before"] = json(conflict.before);
    d["main"] = json(conflict.main);
    d["session"] = json(conflict.session);
    d["deleted_in"] = conflict.isDeletedInMain      ? nb::object(text("main"))
                      : conflict.isDeletedInSession ? nb::object(text("session"))
                                                    : nb::none();
    d["reason"] = text(conflict.reason);
    d["main_user"] = text(conflict.mainUser.value);
    d["session_user"] = text(conflict.sessionUser.value);
    constexpr const char* kTake[] = {nullptr, "main", "session"};
    const char* const take = kTake[std::size_t(conflict.take)];
    d["take"] = take ? nb::object(text(take)) : nb::none();
    return d;
}

nb::dict toDictionary(const client::SessionMerged& merged) {
    nb::list edits, conflicts;
    for (const Edit& edit : merged.edits)
        edits.append(toDictionary(edit.layer, edit.address.path, edit.action));
    for (const client::SessionConflict& one : merged.conflicts) conflicts.append(toDictionary(one));
    nb::dict d;
    d["revision"] = merged.revision;
    d["edits"] = edits;
    d["created"] = strings(merged.created);
    d["conflicts"] = conflicts;
    d["dropped"] = merged.dropped;
    return d;
}

nb::dict toDictionary(const client::UndoResult& result) {
    nb::list kept;
    for (const client::KeptByUndo& one : result.kept) {
        nb::dict d;
        d["layer"] = text(one.layer.value);
        d["path"] = text(one.path);
        d["field"] = one.field.empty() ? nb::object(nb::none()) : nb::object(text(one.field));
        d["part"] = part(one.part);
        d["author"] = text(one.author.value);
        d["reason"] = text(one.reason);
        kept.append(d);
    }
    nb::dict d;
    d["done"] = result.done;
    d["label"] = text(result.label);
    d["kept"] = kept;
    return d;
}

nb::dict toDictionary(const LayerState& state) {
    nb::dict d;
    putFields(d, state);
    return d;
}

nb::dict toDictionary(const Presence& presence) {
    nb::dict d;
    putFields(d, presence);
    if (presence.camera.empty()) d["camera"] = nb::none();
    const auto colour = userColour(presence.user);
    d["colour"] = nb::make_tuple(colour[0], colour[1], colour[2]);
    return d;
}

nb::list toDictionaries(const std::map<ClientId, Presence>& presences) {
    nb::list all;
    for (const auto& [client, presence] : presences) all.append(toDictionary(presence));
    return all;
}

nb::list toDictionaries(const std::map<LayerId, LayerState>& states) {
    nb::list all;
    for (const auto& [layer, state] : states) all.append(toDictionary(state));
    return all;
}

nb::list toDictionaries(const client::BlameResult& found) {
    nb::list opinions;
    for (const client::BlamedContent& one : found.opinions) opinions.append(toDictionary(one));
    return opinions;
}

nb::tuple toTuple(const client::LogPage& page) {
    nb::list commits;
    for (const Commit& commit : page.commits) commits.append(toDictionary(commit));
    return nb::make_tuple(commits, page.next.before, page.next.filter.path,
                          page.end == client::LogPage::End::More);
}

nb::tuple toTuple(const client::Permission& permission) {
    return nb::make_tuple(permission.isAllowed, text(permission.why));
}

nb::dict toDictionary(const client::Event& event) {
    return std::visit([](const auto& each) { return convert(each); }, event);
}

}  // namespace usdlive
