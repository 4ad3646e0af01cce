// Makes uploaded big values files of the project.
#include "project/files/NewFiles.h"

#include "usdlive/common/core/FilePath.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

std::optional<Error> NewFiles::objection(const Session& session, const UploadFile& request) const {
    if (auto valid = checkFilePath(request.path); !valid) return valid.error();
    if (request.size > maxBytes_)
        return Error{ErrorCode::BlobTooLarge, inQuotes(request.path) + " has " +
                                                  std::to_string(request.size) +
                                                  " bytes; at most " + std::to_string(maxBytes_) +
                                                  " are accepted (--max-blob-mib)"};
    if (auto denied = access_->toAction(session.subject, ProjectAction::Upload, {request.path},
                                        "upload " + request.path))
        return denied;
    return store_->whyNotWritable();
}

void NewFiles::upload(const Session& session, const UploadFile& request) {
    if (const auto error = objection(session, request)) {
        activity_->record({"upload refused", session.subject.user, {}, error->message});
        return sessions_->sendError(session, *error, request.request);
    }
    files_->storeFile(
        session.id, request.request,
        {request.path, request.hash, request.size, request.overwrite.value_or(false)});
}

void NewFiles::stored(SessionId id, std::uint64_t request, const std::string& path,
                      const Result<bool>& complete) {
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (!complete) {
        activity_->record({"upload refused", session->subject.user, {}, complete.error().message});
        return sessions_->sendError(*session, complete.error(), request);
    }
    if (*complete) activity_->record({"file uploaded", session->subject.user, {}, path});
    sessions_->send(*session, FileUploaded{request, path, *complete});
}

}  // namespace usdlive::server
