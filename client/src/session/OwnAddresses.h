// The addresses of own edits that are not sent.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "session/PendingTransactions.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// Translates the addresses of own edits that are not sent to the present revision, while others
/// move specs and objects (M3, M15).
class OwnAddresses {
public:
    /// The arguments belong to the session: its id, the confirmed side, and the own transactions.
    OwnAddresses(const ClientId& self, const NamespaceLog& log, const OwnCreations& creations,
                 const Revision& revision, PendingTransactions& pending)
        : self_(self), log_(log), creations_(creations), revision_(revision), pending_(pending) {}

    /// An address that no server can resolve: the creation by the edit itself. The edit keeps its
    /// place in the transaction, is dropped (M4), and is reported to its author as dropped.
    [[nodiscard]] static Address unresolvable(const Creation& number) { return {{}, number}; }

    /// Translates the addresses of an edit at revision `since`. Specs that pending work creates
    /// keep the address by creation; committed ones get a path.
    void renew(Edit& edit, Revision since, const Creation& number, bool isRenewed = false) const;
    /// Gives the edits of an unsent transaction addresses at the present revision. If objects have
    /// moved, all unsent transactions get them, so that none has an older base than those before
    /// it.
    void rebase(Pending& pending);
    /// Does the same for a transaction that is not in the queue, and leaves its base.
    void renewWithPlaces(Pending& pending);

private:
    void renew(Pending& pending);
    void renewNames(Edit& edit, const AddressResolver& resolver, const Creation& number) const;
    [[nodiscard]] bool objectsMovedSince(Revision base) const;
    void notePlaces();
    void notePlaces(Pending& pending);
    [[nodiscard]] const Pending* pendingWith(const Creation& creation, const Pending& later) const;
    [[nodiscard]] std::optional<std::string> placeOf(const Creation& creation,
                                                     const Pending& later) const;
    [[nodiscard]] bool followPlace(Pending& pending, std::uint32_t index) const;

    const ClientId& self_;
    const NamespaceLog& log_;
    const OwnCreations& creations_;
    const Revision& revision_;
    PendingTransactions& pending_;
};

}  // namespace usdlive::client
