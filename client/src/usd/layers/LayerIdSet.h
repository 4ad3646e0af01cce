// A set of identifiers of layers.
#pragma once

#include <string>
#include <unordered_set>

namespace usdlive::layers {

/// The identifiers of the layers that something is true of.
class LayerIdSet {
public:
    [[nodiscard]] bool contains(const std::string& id) const { return ids_.contains(id); }
    /// Inserts or erases the identifier. Returns true if the set has changed.
    bool assign(const std::string& id, bool member) {
        return member ? ids_.insert(id).second : ids_.erase(id) > 0;
    }
    void clear() { ids_.clear(); }

private:
    std::unordered_set<std::string> ids_;
};

}  // namespace usdlive::layers
