// Serves a project's files and its layers as of one revision over HTTP (AS1-AS4).
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "app/LastUsed.h"
#include "app/SharedStore.h"
#include "app/Workers.h"
#include "files/AssetFiles.h"
#include "files/LayerFiles.h"
#include "project/CommitStore.h"
#include "transport/FileRequest.h"
#include "transport/HttpServer.h"
#include "transport/Log.h"

namespace usdlive::server {

class CompressedContents;

/// A project's files over HTTP. A layer with commits is served as the history says; all other
/// files, also layers that nobody has opened yet, are served as they are on the disk. Any thread.
class ServedAssets {
public:
    /// `workers` is stopped before the other arguments and this object are destroyed.
    ServedAssets(std::string project, AssetFiles& assets, LayerFiles& layers, SharedStore& store,
                 WorkerShares& workers, const PublicText& texts, Log& log);

    /// Answers on a worker.
    void answer(const FileRequest& request, const HttpAnswer& answer);

private:
    /// A revision that a request names.
    struct Moment {
        Revision revision = 0;
        CommitStore::Head head;
        CommitStore::Base base;
    };
    /// One line of the list of files: a file, or a layer at a version.
    struct Listed {
        const AssetFile* file = nullptr;
        std::string version = {};
    };
    using Listing = std::map<std::string, Listed>;
    /// A list as it was sent last.
    struct SentList {
        std::string etag;
        std::shared_ptr<const Bytes> body;
        AssetList files;  // that it was made of
    };
    /// The bytes of a layer's file at a version.
    struct Rendered {
        std::shared_ptr<const Bytes> bytes;
        std::string hash;
    };

    [[nodiscard]] HttpReply reply(const FileRequest& request);
    [[nodiscard]] HttpReply list(const FileRequest& request);
    [[nodiscard]] std::optional<HttpReply> sentBefore(const AssetList& files);
    [[nodiscard]] HttpReply replyFor(const Listing& listing, const std::optional<Moment>& at,
                                     const AssetList& files);
    [[nodiscard]] std::string etagOf(const Listing& listing, const std::optional<Moment>& at) const;
    [[nodiscard]] std::string bodyOf(const Listing& listing, const std::optional<Moment>& at) const;
    [[nodiscard]] Result<void> addVersions(Listing& listing, const Moment& at);
    [[nodiscard]] HttpReply file(const FileRequest& request);
    [[nodiscard]] HttpReply layer(const LayerId& layer, const LayerVersion& version);
    [[nodiscard]] Result<Moment> moment(const FileRequest& request);
    [[nodiscard]] Result<Rendered> rendered(const LayerId& layer, const LayerVersion& version);
    [[nodiscard]] HttpReply replyWith(const SentList& list);
    void setContent(HttpReply& reply, std::shared_ptr<HttpContent> content,
                    const std::string& name);
    void hashTheRest(std::size_t missing);
    [[nodiscard]] std::function<void(std::function<void()>)> downloads() const;

    const std::string project_;
    LayerFiles& layers_;
    SharedStore& store_;
    WorkerShares& workers_;
    const PublicText& texts_;
    Log& log_;
    AssetFiles& assets_;
    const std::shared_ptr<CompressedContents> compressed_;  // shared with replies under way

    std::mutex mutex_;  // guards the next members
    SentList listOfAll_, listWithoutLayers_;
    static constexpr std::size_t kRenderedBytes = std::size_t(256) << 20;
    LastUsed<std::pair<LayerId, std::string>, Rendered> rendered_{kRenderedBytes};  // by version
    bool isHashing_ = false;
};

}  // namespace usdlive::server
