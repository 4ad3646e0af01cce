// Requests to create layers and to list the files that are not served.
#pragma once

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/layers/FileStates.h"
#include "project/layers/LayerTable.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Creates layers (FI6), and lists the skipped files of the folder (FI5).
class NewLayers {
public:
    NewLayers(const StoreCondition& store, LayerTable& layers, FileStates& fileStates,
              SessionTable& sessions, const AccessPolicy& access, const Ports& ports)
        : store_(store),
          layers_(layers),
          fileStates_(fileStates),
          sessions_(sessions),
          access_(access),
          files_(ports.files),
          activity_(ports.activity) {}

    void create(const Session& session, const CreateLayer& request);
    void listSkipped(const Session& session, const ListSkipped& request);

    // Answers of ports::Files.
    void created(SessionId session, std::uint64_t request, const LayerId& layer,
                 const Result<void>& created);
    void skippedListed(SessionId session, std::uint64_t request,
                       Result<std::vector<SkippedFile>> skipped);

private:
    [[nodiscard]] std::optional<Error> objection(const Session& session,
                                                 const LayerId& layer) const;

    Wire<const StoreCondition> store_;
    Wire<LayerTable> layers_;
    Wire<FileStates> fileStates_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;
};

}  // namespace usdlive::server
