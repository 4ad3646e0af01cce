// Reads the history over the session of an editor.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "history/HistoryReader.h"
#include "session/Session.h"
#include "usdlive/client/history/History.h"

namespace usdlive::client {

/// Reads the history over the session of an editor, which goes on meanwhile. Belongs to the thread
/// of the session.
class SessionHistory final : public HistoryReader {
public:
    /// Both are called while this object waits for the server.
    struct Editor {
        /// Waits until something is received, for some milliseconds at most, and works on it.
        /// Returns whether something was received.
        std::function<bool()> step;
        /// Returns why there is no connection.
        std::function<Error()> notThere;
    };
    /// `session` outlives this object.
    SessionHistory(Session& session, Editor editor)
        : session_(session), editor_(std::move(editor)) {}

    // See Client::readLog() and Client::blame().
    [[nodiscard]] Result<LogPage> log(const LogQuery& query);
    [[nodiscard]] Result<BlameResult> blame(const LayerId& layer, const std::string& path,
                                            bool below);
    /// Returns an error if there is no connection, or the project has no such layer.
    [[nodiscard]] Result<void> checkLayer(const LayerId& layer) const;
    /// Returns an error if there is no such revision yet, or it is 0.
    [[nodiscard]] Result<void> checkRevision(Revision revision) const;
    /// Returns an error if the layer cannot be read at a revision, which says what can be read.
    /// Waits for the server.
    [[nodiscard]] Result<void> checkReadable(const LayerId& layer, Revision revision);

    [[nodiscard]] Revision newest() const override { return session_.revision(); }
    [[nodiscard]] Revision base() const override { return session_.welcome()->base.value_or(0); }
    [[nodiscard]] Result<std::vector<Commit>> readLog(Revision from, Revision to) override;
    [[nodiscard]] Result<Content> readLayer(const LayerId& layer, Revision revision) override;

    /// Works on what is received until `done` returns true. Error: NotConnected, if nothing is
    /// received for a minute.
    [[nodiscard]] Result<void> waitUntil(const std::function<bool()>& done) const;

private:
    Session& session_;
    const Editor editor_;
};

}  // namespace usdlive::client
