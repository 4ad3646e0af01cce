// Logs the actions of users.
#include "usdlive/server/app/ActivityLog.h"

#include <chrono>
#include <string>

namespace usdlive::server {

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

}  // namespace

void ActivityLog::happened(const Happening& happening) {
    const auto now =
        std::chrono::duration_cast<milliseconds>(steady_clock::now().time_since_epoch());
    std::string key(happening.what);
    key += '\n' + happening.user.value;
    const auto leftOut = limit_.take(key, now.count());
    if (!leftOut) return;
    const std::string_view user = happening.user.value, layer = happening.layer.value;
    if (*leftOut > 0)
        log_.write(LogLevel::Warning, "lines left out",
                   {{"of", happening.what}, {"user", user}, {"count", *leftOut}});
    if (layer.empty() && happening.detail.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}});
    else if (layer.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}, {"detail", happening.detail}});
    else if (happening.detail.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}, {"layer", layer}});
    else
        log_.write(LogLevel::Info, happening.what,
                   {{"user", user}, {"layer", layer}, {"detail", happening.detail}});
}

}  // namespace usdlive::server
