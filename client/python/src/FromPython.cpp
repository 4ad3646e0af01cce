// Requests and searches of the history as the package describes them.
#include "FromPython.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <utility>
#include <vector>

#include "Errors.h"
#include "Fields.h"
#include "usdlive/common/core/LayerPath.h"

namespace nb = nanobind;

namespace usdlive {

AnyRequest requestFrom(const std::string& type, const nb::dict& fields) {
    std::optional<AnyRequest> found;
    forEachRequest([&](auto request) {
        if (type == request.kType) {
            setFields(request, fields);
            found = std::move(request);
        }
    });
    if (!found) raise({ErrorCode::InvalidArgument, "there is no request '" + type + "'"});
    return *std::move(found);
}

client::LogQuery logQueryFrom(const nb::dict& query, Revision before, std::size_t limit) {
    client::LogQuery asked;
    CommitFilter& filter = asked.filter;
    for (const auto& user : nb::cast<std::vector<std::string>>(query["users"]))
        filter.users.insert(UserName{user});
    for (const auto& name : nb::cast<std::vector<std::string>>(query["kinds"])) {
        const auto kind = opinionKindNamed(name);
        if (!kind) raise({ErrorCode::InvalidArgument, "'" + name + "' is no kind of opinion"});
        filter.kinds.insert(*kind);
    }
    if (!query["since"].is_none()) filter.sinceMs = nb::cast<std::int64_t>(query["since"]);
    if (!query["until"].is_none()) filter.untilMs = nb::cast<std::int64_t>(query["until"]);
    if (const auto layer = nb::cast<std::string>(query["layer"]); !layer.empty())
        filter.layer = orRaise(parseLayerId(layer));
    filter.path = nb::cast<std::string>(query["path"]);
    filter.label = nb::cast<std::string>(query["label"]);
    asked.before = before;
    asked.limit = limit;
    return asked;
}

}  // namespace usdlive
