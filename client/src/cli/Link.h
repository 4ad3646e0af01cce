#pragma once

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "usdlive/client/session/Session.h"
#include "usdlive/client/transport/Connection.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::cli {

/// A session without an editor, for commands that ask a server something. One thread.
class Link final : public client::SessionHost, public client::LayerView, public usd::BlobSource {
public:
    /// Connects and greets in the name of `user`. Fails at the first attempt: a person is waiting.
    static Result<std::unique_ptr<Link>> connect(const client::ServerAddress& server, UserName user,
                                                 double timeoutMs);

    [[nodiscard]] client::Session& session() { return *session_; }
    [[nodiscard]] const Welcome& welcome() const { return *session_->welcome(); }

    /// Works for at most about 0.1 s, until something has come. An error: the connection is lost;
    /// going on is possible, it is tried again.
    Result<std::vector<client::Event>> step();
    /// From now on run() shows people how far the server is, where isForPeople().
    void showProgress() { showsProgress_ = true; }
    /// Works until `done`, telling it of each event.
    Result<void> run(const std::function<bool(const std::vector<client::Event>&)>& done);

    /// A layer at a revision (0: now), and the revision it stands at.
    struct Layer {
        LayerDoc doc;
        Revision revision = 0;
    };
    Result<Layer> fetch(const LayerId& layer, Revision revision);
    /// Fetches the big values that the layer names.
    Result<void> fetchBlobs(const LayerDoc& doc);
    /// Fetches the big values that the commit names, as far as the server still has them.
    Result<void> fetchBlobs(const Commit& commit);

    [[nodiscard]] SharedBytes blob(const Hash& hash) override;

private:
    Link(std::unique_ptr<client::Connection> connection, UserName user);

    void send(SharedBytes frames) override;
    [[nodiscard]] SharedBytes localBlob(const Hash& hash) override { return blob(hash); }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool) override;
    // It opens no layers.
    void reset(const LayerId&, const LayerDoc&) override {}
    void apply(const LayerId&, const std::string&, const EditAction&) override {}

    Result<void> fetchBlobs(std::set<Hash> missing, bool all);

    std::unique_ptr<client::Connection> connection_;
    std::unique_ptr<client::Session> session_;
    std::unordered_map<Hash, SharedBytes> blobs_;
    bool open_ = false;
    bool showsProgress_ = false;
};

}  // namespace usdlive::cli
