// Logs the actions of users.
#include "app/ActivityLog.h"

#include <string>

namespace usdlive::server {

void ActivityLog::record(const ActivityEvent& event) {
    audit_.record({.event = event.what,
                   .user = event.user.value,
                   .project = project_,
                   .layer = event.layer.value,
                   .detail = event.detail});
    std::string key(event.what);
    key += '\n' + event.user.value;
    const auto leftOut = limit_.take(key, LogLimit::nowMs());
    if (!leftOut) return;
    const std::string_view user = event.user.value, layer = event.layer.value;
    if (*leftOut > 0)
        log_.write(LogLevel::Warning, "lines left out",
                   {{"of", event.what}, {"user", user}, {"count", *leftOut}});
    if (user.empty())
        log_.write(LogLevel::Info, event.what, {{"detail", event.detail}});
    else if (layer.empty() && event.detail.empty())
        log_.write(LogLevel::Info, event.what, {{"user", user}});
    else if (layer.empty())
        log_.write(LogLevel::Info, event.what, {{"user", user}, {"detail", event.detail}});
    else if (event.detail.empty())
        log_.write(LogLevel::Info, event.what, {{"user", user}, {"layer", layer}});
    else
        log_.write(LogLevel::Info, event.what,
                   {{"user", user}, {"layer", layer}, {"detail", event.detail}});
}

}  // namespace usdlive::server
