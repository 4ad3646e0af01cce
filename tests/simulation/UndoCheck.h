// Checks what an undo may change.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "session/Session.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::simulation {

/// The registers of a client's confirmed layers that somebody else has written last.
class UndoCheck {
public:
    void committed(const Commit& commit, bool isOwn);
    /// The content of these layers is new.
    void forget(const LayerId& layer) { others_.erase(layer); }
    /// An undo has turned `before` into `after` with `edits`. Returns the register of somebody else
    /// that it has changed; empty: none.
    [[nodiscard]] std::string changed(const LayerDocs& before, const LayerDocs& after,
                                      const std::vector<client::AuthoredEdit>& edits) const;
    [[nodiscard]] std::size_t size() const { return others_.size(); }

private:
    struct Register {
        std::string field;
        FieldPart part;
    };
    using Registers = std::multimap<std::string, Register>;  // by path

    static void follow(Registers& registers, const std::string& path, const EditAction& action);
    static void overwrite(Registers& registers, const std::string& path, const std::string& field,
                          const FieldPart& part);

    std::map<LayerId, Registers> others_;
};

}  // namespace usdlive::simulation
