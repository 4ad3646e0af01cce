// Reads, compares and writes the content of a layer, register by register.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/path.h>

#include <map>
#include <string>
#include <variant>
#include <vector>

namespace usdlive::content {

/// The part of a field that is a register: the key path of a dictionary entry, or the time of a
/// sample. std::monostate is the whole field.
using Part = std::variant<std::monostate, std::vector<std::string>, double>;

/// A sublayer with its offset. The field `subLayers` is read and written as a `Sublayers`.
struct Sublayer {
    std::string path;
    pxr::SdfLayerOffset offset;
    bool operator==(const Sublayer&) const = default;
    template <class HashState>
    friend void TfHashAppend(HashState& state, const Sublayer& sublayer) {
        state.Append(sublayer.path, sublayer.offset);
    }
};
using Sublayers = std::vector<Sublayer>;

/// The fields of a spec, without the lists of its children.
using Fields = std::map<pxr::TfToken, pxr::VtValue>;

/// A register that differs. An empty value means that it is absent.
struct Change {
    pxr::SdfPath path;
    pxr::TfToken field;
    Part part;
    pxr::VtValue before, after;
};

/// Returns no fields if there is no spec.
[[nodiscard]] Fields readFields(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
/// Returns an empty value if the register is absent.
[[nodiscard]] pxr::VtValue readRegister(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                                        const pxr::TfToken& field, const Part& part);
/// Writes one register of an existing spec; an empty value erases it.
void writeRegister(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                   const pxr::TfToken& field, const Part& part, const pxr::VtValue& value);

/// Compares contents: a NaN equals itself.
[[nodiscard]] bool isSame(const pxr::VtValue& left, const pxr::VtValue& right);
/// Returns the registers that differ between two contents of the spec at `path`.
[[nodiscard]] std::vector<Change> changesBetween(const pxr::SdfPath& path, const Fields& before,
                                                 const Fields& after);

}  // namespace usdlive::content
