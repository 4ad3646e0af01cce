// Makes random edits.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "SimRandom.h"
#include "session/Session.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::simulation {

/// Makes random edits, as an editor would make them on the content that it shows. The vocabulary is
/// small, so that several editors conflict often.
class EditScript {
public:
    /// If `identifiesPrims` is true, each new prim has an own key (NamespaceEdits::identity).
    EditScript(SimRandom& random, std::uint64_t& lastValue, bool identifiesPrims)
        : random_(random), lastValue_(lastValue), identifiesPrims_(identifiesPrims) {}

    /// Returns edits that (mostly) apply to `doc` one after the other: one edit, or a creation with
    /// its fields. Puts big values into `blobs`.
    std::vector<client::AuthoredEdit> edits(const LayerId& layer, const LayerDoc& doc,
                                            std::map<Hash, SharedBytes>& blobs, bool bigValues);
    /// Returns another write of an attribute's value, as a slider makes it; nothing if there is no
    /// attribute.
    std::vector<client::AuthoredEdit> slide(const LayerId& layer, const LayerDoc& doc,
                                            std::map<Hash, SharedBytes>& blobs, bool bigValues);
    /// Returns the content of a layer before the first edit.
    LayerDoc start();

private:
    std::string somewhere(const LayerDoc& doc, std::optional<SpecKind> kind);
    std::optional<EditAction> structural(const LayerDoc& doc, std::string& path);
    std::optional<EditAction> create(const LayerDoc& doc, std::string& path);
    std::optional<EditAction> move(const LayerDoc& doc, const std::string& path);
    std::optional<EditAction> place(const LayerDoc& doc, const std::string& path);
    std::optional<EditAction> fieldOf(SpecKind kind);
    EditAction attributeField();
    EditAction primField();
    EditAction rootField();
    EditAction dictionary(const std::string& field);
    EditAction list(const std::string& field, ValueType type, const Value& item,
                    const Value& other);
    Dictionary someKeys();
    TimeSamples someSamples();
    Value specifier();
    Value number();
    Value bigValue(std::map<Hash, SharedBytes>& blobs);
    Value somePath();
    Value someProperty();

    SimRandom& random_;
    std::uint64_t& lastValue_;  // each written value is new
    const bool identifiesPrims_;
};

}  // namespace usdlive::simulation
