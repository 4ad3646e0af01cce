#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "SimRandom.h"
#include "usdlive/client/session/Session.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::simulation {

/// Thinks up edits as an editor would make them on what it sees. The vocabulary is small, so that
/// several editors get in each other's way.
class EditScript {
public:
    EditScript(SimRandom& random, std::uint64_t& lastValue)
        : random_(random), lastValue_(lastValue) {}

    /// Edits that apply to `doc` one after the other (mostly): one, or a creation with what belongs
    /// to it. Big values are put into `blobs`.
    std::vector<client::AuthoredEdit> edits(const LayerId& layer, const LayerDoc& doc,
                                            std::map<Hash, SharedBytes>& blobs, bool bigValues);
    /// Another write of a value of an attribute, as of a slider; none where there is no attribute.
    std::vector<client::AuthoredEdit> slide(const LayerId& layer, const LayerDoc& doc,
                                            std::map<Hash, SharedBytes>& blobs, bool bigValues);
    /// Content of a layer before anybody edits it.
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
    std::uint64_t& lastValue_;  // every value written is another one
};

}  // namespace usdlive::simulation
