// Requests to add files that are no layers to the project.
#pragma once

#include <cstdint>
#include <string>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/lines/StoreCondition.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Makes uploaded big values files of the project (FI7).
class NewFiles {
public:
    /// `maxBytes` is the limit of a file.
    NewFiles(std::uint64_t maxBytes, const StoreCondition& store, SessionTable& sessions,
             const AccessPolicy& access, const Ports& ports)
        : maxBytes_(maxBytes),
          store_(store),
          sessions_(sessions),
          access_(access),
          files_(ports.files),
          activity_(ports.activity) {}

    void upload(const Session& session, const UploadFile& request);

    /// Answer of ports::Files.
    void stored(SessionId session, std::uint64_t request, const std::string& path,
                const Result<bool>& complete);

private:
    [[nodiscard]] std::optional<Error> objection(const Session& session,
                                                 const UploadFile& request) const;

    std::uint64_t maxBytes_;
    Wire<const StoreCondition> store_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;
};

}  // namespace usdlive::server
