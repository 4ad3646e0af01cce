// Translates the addresses of transactions to the present (M3, M15).
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/PathsInValues.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive {

/// Returns the part of `path` after `created`, in the form of an Address with a creation: "" for
/// the spec itself, "/B.x" below a prim, "B.x" below a variant. Below a variant set "/A{v=}" it is
/// the part after the owner of the set ("{v=one}B.x"). Precondition: specpath::hasPrefix(path,
/// created).
[[nodiscard]] std::string relativePath(std::string_view path, std::string_view created);
/// Returns the path of `relative` below `created`. `created` may have been renamed since: the name
/// of the set in `relative` is ignored. Returns nothing if such a spec cannot have this child.
[[nodiscard]] std::optional<std::string> absolutePath(std::string_view relative,
                                                      std::string_view created);

/// Translates what the edits of one transaction name: the server when it executes it, and a client
/// before it sends it.
class AddressResolver {
public:
    using Find = std::function<const OwnCreations::Entry*(const Creation&)>;
    /// `log` must outlive this object. `find` returns the entry of an own creation or vacated
    /// place, or nullptr.
    AddressResolver(const NamespaceLog& log, const ClientId& author, Revision base, Find find)
        : log_(log),
          author_(NamespaceLog::authorOf(author)),
          base_(log.markAfter(base)),
          find_(std::move(find)) {}

    /// Returns the path of a spec. Errors: SpecDeleted (also for an unknown creation), InvalidEdit
    /// (a creation in another layer), InvalidPath.
    [[nodiscard]] Result<std::string> spec(const LayerId& layer, const Address& address) const;
    /// Returns the path of a place, at which a spec is to be created or an object is to be moved.
    /// Errors as for spec().
    [[nodiscard]] Result<std::string> place(const LayerId& layer, const Address& address) const;
    /// Returns the path of a place whose object has been deleted.
    [[nodiscard]] std::string vacated(const LayerId& layer, const Address& address) const;
    /// Returns the path of what the path `written` in a value names, or nothing if that has been
    /// deleted or was never created.
    [[nodiscard]] std::optional<std::string> named(const LayerId& layer, const Address& name,
                                                   std::string_view written, PathRole role) const;
    /// Returns the place of an address at the base; nothing if it is unknown, or if what is created
    /// there needs no translation.
    [[nodiscard]] std::optional<PlaceBefore> before(const LayerId& layer,
                                                    const Address& address) const;
    /// The first entry after the base revision.
    [[nodiscard]] std::uint64_t baseMark() const { return base_; }

private:
    [[nodiscard]] Result<PlaceBefore> origin(const LayerId& layer, const Address& address) const;
    [[nodiscard]] std::optional<PlaceBefore> movedBefore(const LayerId& layer,
                                                         const Address& address,
                                                         PlaceBefore place) const;
    [[nodiscard]] std::optional<std::string> aboveBefore(const LayerId& layer,
                                                         const OwnCreations::Entry& entry) const;

    const NamespaceLog& log_;
    NamespaceLog::Author author_;
    std::uint64_t base_;
    Find find_;
};

/// Returns the present path of what a path named before entry number `mark`, or nothing if it has
/// been deleted.
[[nodiscard]] std::optional<std::string> carried(const NamespaceLog& log, const LayerId& layer,
                                                 std::string_view path, std::uint64_t mark,
                                                 PathRole role);

}  // namespace usdlive
