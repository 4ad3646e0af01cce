// A session with one line of history, without an editor.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "history/HistoryReader.h"
#include "session/Session.h"
#include "transport/Connection.h"
#include "usdlive/common/layer/Blobs.h"
#include "values/FileUploads.h"

namespace usdlive::client {

/// A session with the main line of a project or a live session, for what reads its history or
/// edits whole layers, without an editor. One thread. The calls block.
class LineLink : public SessionHost, public LayerView, public HistoryReader, public BlobSource {
public:
    /// Connects in the name of `user`. Fails after the first attempt, because somebody is waiting.
    static Result<std::unique_ptr<LineLink>> connect(const ServerAddress& server, UserName user,
                                                     double timeoutMs);

    [[nodiscard]] Session& session() { return *session_; }
    [[nodiscard]] const Session& session() const { return *session_; }
    [[nodiscard]] const Welcome& welcome() const { return *session_->welcome(); }

    /// Works until something is received, for at most about 0.1 s. An error means that the
    /// connection is lost; further calls try to connect again.
    Result<std::vector<Event>> step();
    /// Works until `done` returns true. Calls it with the events.
    virtual Result<void> run(const std::function<bool(const std::vector<Event>&)>& done);

    /// Sends a request and waits for its answer.
    template <IsSingleRequest Request>
    Result<typename Request::Answer> ask(Request request) {
        const std::uint64_t number = session_->request(std::move(request));
        std::optional<Result<typename Request::Answer>> answer;
        const auto ran = run([&](const std::vector<Event>& events) {
            for (const auto& one : events) {
                const auto* answered = std::get_if<event::Answered<Request>>(&one);
                const auto* error = std::get_if<event::ServerError>(&one);
                if (answered && answered->answer.request == number) answer = answered->answer;
                if (error && error->message.request == number)
                    answer = tl::unexpected(toError(error->message));
            }
            return answer.has_value();
        });
        if (!ran && !answer) return tl::unexpected(ran.error());
        return *std::move(answer);
    }

    [[nodiscard]] Revision newest() const override { return welcome().revision; }
    [[nodiscard]] Revision base() const override { return welcome().base.value_or(0); }
    Result<std::vector<Commit>> readLog(Revision from, Revision to) override;
    Result<Content> readLayer(const LayerId& layer, Revision revision) override;
    /// Fetches the big values of the layer.
    Result<void> fetchBlobs(const LayerDoc& doc);
    /// Fetches the big values of the commit that the server still has.
    Result<void> fetchBlobs(const Commit& commit);

    [[nodiscard]] SharedBytes blob(const Hash& hash) override;
    /// Takes big values that are not here from another link, which must outlive this one.
    void lend(LineLink& lender) { lender_ = &lender; }

protected:
    LineLink(std::unique_ptr<Connection> connection, UserName user);
    Result<void> waitForWelcome(const ServerAddress& server, double timeoutMs);

    std::optional<FileUploads> uploads_;

private:
    void send(SharedBytes frames) override;
    std::size_t bulkBytes() override { return connection_->bulkBytes(); }
    void blobStored(const Hash& hash) override {
        if (uploads_) uploads_->blobStored(hash);
    }
    [[nodiscard]] SharedBytes localBlob(const Hash& hash) override { return blob(hash); }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool) override;
    // Never called, because this session opens no layers.
    void reset(const LayerId&, const LayerDoc&) override {}
    void apply(const LayerId&, const std::string&, const EditAction&) override {}

    Result<void> fetchBlobs(std::set<Hash> missing, bool all);

    std::unique_ptr<Connection> connection_;
    std::unique_ptr<Session> session_;
    std::unordered_map<Hash, SharedBytes> blobs_;
    LineLink* lender_ = nullptr;
    bool open_ = false;
};

}  // namespace usdlive::client
