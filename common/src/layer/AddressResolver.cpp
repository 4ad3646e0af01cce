// Translates the addresses of transactions to the present (M3, M15).
#include "usdlive/common/layer/AddressResolver.h"

#include <utility>

#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

tl::unexpected<Error> deleted(const std::string& path) {
    return fail(ErrorCode::SpecDeleted, inQuotes(path) + " has been deleted");
}

}  // namespace

std::string relativePath(std::string_view path, std::string_view created) {
    if (path == created) return {};
    if (created.ends_with("=}")) return std::string(path.substr(created.rfind('{')));
    return std::string(path.substr(created.size()));
}

std::optional<std::string> absolutePath(std::string_view relative, std::string_view created) {
    if (relative.empty()) return std::string(created);
    if (created.ends_with("=}")) {
        const std::size_t equals = relative.find('=');
        if (!relative.starts_with('{') || equals == std::string_view::npos) return std::nullopt;
        return std::string(created.substr(0, created.size() - 1))
            .append(relative.substr(equals + 1));
    }
    const bool afterVariant = created.ends_with('}');
    const bool separated = std::string_view("/.{").find(relative.front()) != std::string_view::npos;
    if (afterVariant && relative.starts_with('/')) relative.remove_prefix(1);
    if (!afterVariant && !separated) return std::nullopt;
    return std::string(created).append(relative);
}

std::optional<std::string> carried(const NamespaceLog& log, const LayerId& layer,
                                   std::string_view path, std::uint64_t mark, PathRole role) {
    if (role == PathRole::Object) return log.translateFrom(layer, std::string(path), mark);
    // A place keeps its name: only its parent can have moved.
    const auto parent = log.translateFrom(layer, specpath::parent(path), mark);
    if (!parent) return std::nullopt;
    const PathElement last = specpath::last(path);
    return specpath::child(*parent, last.list, last.name);
}

// Returns the path at the moment from which it has to be translated.
Result<PlaceBefore> AddressResolver::origin(const LayerId& layer, const Address& address) const {
    if (!address.creation) return PlaceBefore{address.path, base_};
    const OwnCreations::Entry* entry = find_(*address.creation);
    if (!entry) return fail(ErrorCode::SpecDeleted, "the spec of the edit was never created");
    if (entry->layer != layer)
        return fail(ErrorCode::InvalidEdit,
                    "the spec of the edit was created in " + inQuotes(entry->layer.value));
    auto path = absolutePath(address.path, entry->path);
    if (!path)
        return fail(ErrorCode::InvalidPath,
                    inQuotes(address.path) + " cannot follow " + inQuotes(entry->path));
    if (const auto valid = specpath::parse(*path); !valid) return tl::unexpected(valid.error());
    return PlaceBefore{*std::move(path), entry->mark};
}

Result<std::string> AddressResolver::spec(const LayerId& layer, const Address& address) const {
    auto from = origin(layer, address);
    if (!from) return tl::unexpected(from.error());
    auto path = log_.translateFrom(layer, from->path, from->mark);
    if (!path) return deleted(from->path);
    return *std::move(path);
}

// Its parent can have moved, or an author moved the object at the place (M15). An earlier spec with
// the same path that was moved or deleted is another spec.
Result<std::string> AddressResolver::place(const LayerId& layer, const Address& address) const {
    auto from = origin(layer, address);
    if (!from) return tl::unexpected(from.error());
    if (from->path == "/") return from->path;  // LayerDoc reports the error
    std::optional<PlaceBefore> place = *from;
    if (address.creation) place = movedBefore(layer, address, *from);
    std::optional<std::string> path;
    if (place) path = log_.translatePlace(layer, std::move(place->path), place->mark);
    if (!path) return deleted(from->path);
    return *std::move(path);
}

// Others can have moved the object at the place, and not what is above it, after the base and
// before the spec above was created. Own moves since then have moved the object, too.
std::optional<PlaceBefore> AddressResolver::movedBefore(const LayerId& layer,
                                                        const Address& address,
                                                        PlaceBefore place) const {
    const OwnCreations::Entry* entry = find_(*address.creation);
    const auto above = aboveBefore(layer, *entry);
    const auto here = above ? absolutePath(address.path, *above) : std::nullopt;
    if (!here || !specpath::parse(*here)) return place;
    auto now = log_.followPlace(layer, *here, *above, base_, entry->mark, author_);
    if (!now.above) return place;
    if (!now.place) return std::nullopt;
    if (now.left) return PlaceBefore{*std::move(now.place), *now.left};
    if (auto path = absolutePath(relativePath(*now.place, *now.above), entry->path))
        place.path = *std::move(path);
    return place;
}

std::string AddressResolver::vacated(const LayerId& layer, const Address& address) const {
    const auto from = origin(layer, address);
    const bool isKnown = from && from->path != "/";
    return isKnown ? log_.translateVacated(layer, from->path, from->mark) : "/_";
}

std::optional<std::string> AddressResolver::named(const LayerId& layer, const Address& name,
                                                  std::string_view written, PathRole role) const {
    if (name.path.empty() && !name.creation) return std::string(written);
    const auto from = origin(layer, name);
    if (!from && from.error().code == ErrorCode::SpecDeleted) return std::nullopt;
    if (!from || from->path == "/") return std::string(written);
    return carried(log_, layer, from->path, from->mark, role);
}

std::optional<PlaceBefore> AddressResolver::before(const LayerId& layer,
                                                   const Address& address) const {
    if (!address.creation) return PlaceBefore{address.path, base_};
    const OwnCreations::Entry* entry = find_(*address.creation);
    const auto above = entry ? aboveBefore(layer, *entry) : std::nullopt;
    auto path = above ? absolutePath(address.path, *above) : std::nullopt;
    if (!path || !specpath::parse(*path)) return std::nullopt;
    return PlaceBefore{*std::move(path), base_};
}

// The place of an own creation at the base.
std::optional<std::string> AddressResolver::aboveBefore(const LayerId& layer,
                                                        const OwnCreations::Entry& entry) const {
    if (!entry.place || entry.mark <= base_) return std::nullopt;
    return log_.translatePlaceBetween(layer, entry.place->path, entry.place->mark, base_, author_);
}

}  // namespace usdlive
