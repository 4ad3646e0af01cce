// A session with a test server at its other end.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "session/Session.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::client::sessiontest {

inline const LayerId kShot{"shot.usda"}, kLook{"look.usda"};
inline const ClientId kMe{"me"}, kOther{"other"};

/// A session with an editor whose layers are LayerDocs. At its other end is a server of the test,
/// which executes what the test requests, when the test requests it.
class SessionPeer : public SessionHost, public LayerView {
public:
    explicit SessionPeer(Session::Options options = {})
        : session(with(std::move(options)), *this, *this) {
        docs[kShot];
        docs[kLook];
    }

    // ---- the server

    std::optional<MessageReader> reader{std::in_place};  // belongs to the current connection
    LayerDocs docs;
    NamespaceLog log;
    std::map<ClientId, OwnCreations> creations;
    std::vector<std::pair<Bytes, Hash>> history;  ///< frames with length, chain hashes
    std::deque<Frame> sent;  ///< frames from the session that were not taken yet
    Epoch epoch = 1;
    std::string project = "test";
    StoreId store{"0123456789abcdef0123456789abcdef"};
    std::vector<std::string> features{"previews", "previewValues"};

    [[nodiscard]] Revision head() const { return history.size(); }
    [[nodiscard]] Hash hashAt(Revision revision) const {
        return revision == 0 ? Hash{} : history[revision - 1].second;
    }

    /// Takes the next frame of this kind; drops the frames before it.
    template <class F>
    std::optional<F> take() {
        while (!sent.empty()) {
            Frame frame = std::move(sent.front());
            sent.pop_front();
            if (auto* found = std::get_if<F>(&frame)) return std::move(*found);
        }
        return std::nullopt;
    }
    template <class M>
    std::optional<M> takeControl() {
        while (auto frame = take<ControlFrame>()) {
            const auto message = decodeControl(frame->json);
            if (const auto* found = message ? std::get_if<M>(&*message) : nullptr) return *found;
        }
        return std::nullopt;
    }
    Transaction takeTransaction() {
        auto frame = take<SubmitFrame>();
        if (!frame) throw std::runtime_error("no transaction was sent");
        return std::move(frame->transaction);
    }

    /// Takes a transaction that was sent in parts (FR8).
    Transaction takeParts() {
        SubmitParts parts;
        for (;;) {
            auto frame = take<SubmitFrame>();
            if (!frame) throw std::runtime_error("the last part was not sent");
            auto whole = parts.add(std::move(*frame));
            if (!whole) throw std::runtime_error(whole.error().message);
            if (*whole) return std::move(**whole);
        }
    }

    void deliver(const Frame& frame) { session.received(reader->read(encodeFrame(frame))); }
    void deliver(const ControlMessage& message) { deliver(ControlFrame{encodeControl(message)}); }

    /// Executes a transaction; the commit's frame is appended to `history`.
    Commit commit(const Transaction& transaction) {
        auto outcome =
            execute(docs, log, creations[transaction.id.client], transaction, head() + 1);
        auto* executed = std::get_if<Executed>(&outcome);
        if (!executed) throw std::runtime_error(std::get<Refused>(outcome).error.message);
        Commit commit{.revision = head() + 1,
                      .epoch = epoch,
                      .id = transaction.id,
                      .user = {"user"},
                      .timeMs = 0,
                      .gesture = transaction.gesture,
                      .imported = {},
                      .edits = {},
                      .dropped = executed->dropped,
                      .previous = hashAt(head())};
        const Revision seen = newestSeen(transaction);
        for (const auto& edit : executed->edits) {
            commit.edits.push_back(edit.edit);
            if (std::holds_alternative<DeleteSpec>(edit.edit.action) && seen < head())
                commit.firstUnseen = seen + 1;  // M17
        }
        Bytes frame = encodeFrame(CommitFrame{commit});
        const Hash hash = chainHash(commit.previous, ByteView(frame).subspan(4));
        history.emplace_back(std::move(frame), hash);
        return commit;
    }
    /// Does the same, and sends the commit to the session.
    Commit commitAndTell(const Transaction& transaction) {
        Commit made = commit(transaction);
        deliverCommit(made.revision);
        return made;
    }
    void deliverCommit(Revision revision) {
        session.received(reader->read(history[revision - 1].first));
    }
    /// Returns a transaction of somebody else, based on the current content.
    Transaction foreign(std::vector<Edit> edits, std::uint64_t gesture = 0) {
        return {{kOther, ++lastForeign_}, head(), gesture, std::move(edits)};
    }

    void sendSnapshot(const OpenLayer& open) {
        const LayerDoc& doc = docs.at(open.layer);
        deliver(LayerOpened{open.request, open.layer, head(), doc.specCount()});
        SnapshotEncoder encoder(doc, open.request);
        while (const auto frame = encoder.next()) deliver(Frame(*frame));
    }
    Welcome welcomeMessage(bool resumed) const {
        Welcome message;
        message.protocol = kProtocolVersion;
        message.project = project;
        message.store = store;
        message.epoch = epoch;
        message.revision = head();
        message.hash = hashAt(head());
        message.resumed = resumed;
        message.maxFrameBytes = kMaxFrameBytes;
        message.maxBlobBytes = 1 << 30;
        message.features = features;
        return message;
    }
    /// Connects, and sends the commits that the session has missed.
    Hello connect() {
        sent.clear();
        reader.emplace(reader->takeBegun());
        session.connected();
        const Hello hello = *takeControl<Hello>();
        deliver(welcomeMessage(hello.resume.has_value()));
        if (hello.resume)
            for (Revision revision = hello.resume->revision + 1; revision <= head(); ++revision)
                deliverCommit(revision);
        return hello;
    }
    void join(const LayerId& layer) {
        session.openLayer(layer);
        advance();
        sendSnapshot(*takeControl<OpenLayer>());
        advance();
    }
    void connectAndJoin() {
        connect();
        advance();
        join(kShot);
        events.clear();
    }

    // ---- the editor

    std::map<LayerId, LayerDoc> editor;
    std::map<Hash, SharedBytes> blobs;
    std::vector<Event> events;
    Session session;
    double clockMs = 0;  ///< each reading advances it by a millisecond
    std::int64_t nowMs = 0;
    std::size_t shown = 0;  ///< edits and resets that the editor received

    bool advance(double budgetMs = 1e9) {
        const bool done = session.advance(budgetMs, nowMs += 16);
        for (Event& event : session.takeEvents()) events.push_back(std::move(event));
        return done;
    }
    /// Authors edits like an editor: first in its layer, then in the session.
    void author(std::vector<AuthoredEdit> edits) {
        for (const AuthoredEdit& edit : edits)
            (void)editor.at(edit.layer).apply(edit.path, edit.action);
        session.author(std::move(edits));
        for (Event& event : session.takeEvents()) events.push_back(std::move(event));
    }
    template <class E>
    std::vector<E> eventsOf() const {
        std::vector<E> found;
        for (const Event& event : events)
            if (const auto* one = std::get_if<E>(&event)) found.push_back(*one);
        return found;
    }
    [[nodiscard]] std::string text(const std::string& path, const std::string& field) const {
        const FieldValue* value = editor.at(kShot).field(path, field);
        if (!value) return "-";
        return std::string(textOf(*value->as<Value>()).value_or("?"));
    }
    /// True if the editor, the session's view and, when nothing is pending, the server have the
    /// same content.
    [[nodiscard]] bool agrees() const {
        for (const auto& [layer, doc] : editor) {
            const LayerDoc* view = session.view(layer);
            if (view && !(*view == doc)) return false;
            if (view && session.pendingTransactions() == 0 && !session.inGesture() &&
                !(docs.at(layer) == doc))
                return false;
        }
        return true;
    }

    // SessionHost, LayerView
    void send(SharedBytes frames) override {
        const auto split = splitMessage(*frames);
        for (const ByteView frame : *split) sent.push_back(*decodeFrame(frame));
    }
    bool takesParts = true;  ///< the connection accepts more data
    std::size_t bulkBytes() override { return takesParts ? kChunkBytes : 0; }
    SharedBytes localBlob(const Hash& hash) override {
        const auto found = blobs.find(hash);
        return found == blobs.end() ? nullptr : found->second;
    }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool) override {
        blobs[hash] = std::move(bytes);
    }
    bool needed = true;  ///< big values that have not arrived
    bool needsBlob(const Hash&) override { return needed; }
    void reset(const LayerId& layer, const LayerDoc& doc) override {
        ++shown;
        editor.insert_or_assign(layer, doc);
    }
    void apply(const LayerId& layer, const std::string& path, const EditAction& action) override {
        ++shown;
        const auto done = editor.at(layer).apply(path, action);
        if (!done) throw std::runtime_error("the editor cannot show it: " + done.error().message);
    }

private:
    Session::Options with(Session::Options options) {
        options.client = kMe;
        options.user = {"user"};
        options.clockMs = [this] { return clockMs += 1; };
        options.checksPrediction = true;
        return options;
    }
    std::uint64_t lastForeign_ = 0;
};

// ---- short forms of edits

inline EditAction setText(std::string field, std::string text) {
    return SetField{std::move(field), {}, stringValue(text), {}};
}
inline Edit edit(std::string path, EditAction action, const LayerId& layer = kShot) {
    return {layer, {std::move(path), {}}, std::move(action)};
}
inline AuthoredEdit authored(std::string path, EditAction action, const LayerId& layer = kShot) {
    return {layer, std::move(path), std::move(action)};
}
inline EditAction createPrim() { return CreateSpec{SpecKind::Prim}; }
inline EditAction createAttribute() { return CreateSpec{SpecKind::Attribute}; }
inline EditAction moveTo(std::string parent, std::string name) {
    return MoveSpec{{std::move(parent), {}}, std::move(name)};
}

}  // namespace usdlive::client::sessiontest
