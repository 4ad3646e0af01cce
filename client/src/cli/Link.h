// A session for commands that query a server.
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
#include "usdlive/common/usd/ValueCodec.h"
#include "values/FileUploads.h"

namespace usdlive::cli {

/// A session without an editor, for commands that only query a server. One thread.
class Link final : public client::SessionHost,
                   public client::LayerView,
                   public client::HistoryReader,
                   public BlobSource {
public:
    /// Connects in the name of `user`. Fails after the first attempt, because a person is waiting.
    static Result<std::unique_ptr<Link>> connect(const client::ServerAddress& server, UserName user,
                                                 double timeoutMs);

    [[nodiscard]] client::Session& session() { return *session_; }
    [[nodiscard]] const client::Session& session() const { return *session_; }
    [[nodiscard]] const Welcome& welcome() const { return *session_->welcome(); }

    /// Works until something is received, for at most about 0.1 s. An error means that the
    /// connection is lost; further calls try to connect again.
    Result<std::vector<client::Event>> step();
    /// Makes run() show the server's progress if isForPeople().
    void showProgress() { showsProgress_ = true; }
    /// Works until `done` returns true. Calls it with the events.
    Result<void> run(const std::function<bool(const std::vector<client::Event>&)>& done);

    /// Sends a request and waits for its answer.
    template <IsSingleRequest Request>
    Result<typename Request::Answer> ask(Request request) {
        const std::uint64_t number = session_->request(std::move(request));
        std::optional<Result<typename Request::Answer>> answer;
        const auto ran = run([&](const std::vector<client::Event>& events) {
            for (const auto& one : events) {
                const auto* answered = std::get_if<client::event::Answered<Request>>(&one);
                const auto* error = std::get_if<client::event::ServerError>(&one);
                if (answered && answered->answer.request == number) answer = answered->answer;
                if (error && error->message.request == number)
                    answer = tl::unexpected(toError(error->message));
            }
            return answer.has_value();
        });
        if (!ran && !answer) return tl::unexpected(ran.error());
        return *std::move(answer);
    }

    /// Uploads a file of this machine, which becomes `path` in the project.
    Result<void> upload(const std::string& file, const std::string& path, bool overwrite);

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
    void lend(Link& lender) { lender_ = &lender; }

private:
    Link(std::unique_ptr<client::Connection> connection, UserName user);

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

    std::unique_ptr<client::Connection> connection_;
    std::unique_ptr<client::Session> session_;
    std::optional<client::FileUploads> uploads_;
    std::unordered_map<Hash, SharedBytes> blobs_;
    Link* lender_ = nullptr;
    bool open_ = false;
    bool showsProgress_ = false;
};

}  // namespace usdlive::cli
