// Moves prims in all layers at once, and checks where the writes of others arrive.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "SimRandom.h"
#include "SimWorld.h"
#include "session/Session.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::simulation {

/// The namespace edits of one editor, its writes to prims, and their check (M3, M4, M6).
///
/// Each prim has a key `is<number>` in its `assetInfo` from its creation on. A write adds a key
/// `w<number>`, and remembers the number of the prim that its author showed. In the end the key is
/// on that prim, wherever others have moved it, or the prim is deleted. A namespace edit adds a key
/// to each layer that it changes. In the end all of these layers have it, or none.
class NamespaceEdits {
public:
    using Docs = std::map<LayerId, LayerDoc>;

    NamespaceEdits(SimRandom& random, std::uint64_t& lastValue)
        : random_(random), lastValue_(lastValue) {}

    /// Returns the edit that identifies a new prim.
    static EditAction identity(std::uint64_t number);

    /// Renames or moves prims in all layers that have them, as one transaction: one to three moves,
    /// or a swap, with the targets that lead to them. Applies the edits to `docs`. Returns nothing
    /// and changes nothing if a layer does not allow it.
    std::vector<client::AuthoredEdit> move(Docs& docs);
    /// Writes to some prims, but not to those that only a preview of another editor shows. Applies
    /// the edits to `docs`.
    std::vector<client::AuthoredEdit> write(Docs& docs, const client::Session& session);

    /// Called for each own commit.
    void committed(const Commit& commit);
    /// Called for work that came back (M12).
    void lost(const client::LostWork& work);
    /// Throws SimFailure if a rule does not hold for these layers. `carriesAddresses` is true if
    /// the server knew all moves since each transaction's base (M3, SE6).
    void check(const Docs& layers, bool carriesAddresses, SimReport& report) const;

private:
    enum class End { Pending, Committed, Refused, Dropped, Uncertain };
    struct Write {
        LayerId layer;
        std::string path;  // at the time of the write
        std::string prim;  // key of the prim
        End end = End::Pending;
        // The write was dropped before its prim was committed: the refusal of the transaction that
        // creates the prim did not arrive, and that one was sent again and accepted.
        bool wasBeforePrim = false;
    };
    struct Move {
        std::set<LayerId> layers;
        End end = End::Pending;
    };
    struct Batch {
        Docs docs;
        std::vector<client::AuthoredEdit> edits;
        std::set<LayerId> layers;
    };

    void setEnd(const EditAction& action, End end);
    std::string primOf(const LayerDoc& doc);
    std::string placeFor(const LayerDoc& doc, const std::string& prim);
    bool apply(Batch& batch, const LayerId& layer, const std::string& path, EditAction action);
    bool move(Batch& batch, const std::string& from, const std::string& to);
    bool createParents(Batch& batch, const LayerId& layer, const std::string& parent);
    bool correctTargets(Batch& batch, const LayerId& layer, const std::string& from,
                        const std::string& to);

    SimRandom& random_;
    std::uint64_t& lastValue_;
    bool namesPlaces_ = true;              // this move
    std::map<std::string, Write> writes_;  // by key
    std::map<std::string, Move> moves_;    // by key
    std::set<std::string> madePrims_;      // keys of own prims that are committed
};

}  // namespace usdlive::simulation
