// The metadata `EdfDataParameters` of a prim, and the arguments of a layer that are composed from
// it.
#pragma once

#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/fileFormat.h>

#include <string>

#include "usdlive/edf/DataProvider.h"

namespace usdlive::edf {

using LayerArguments = pxr::SdfFileFormat::FileFormatArguments;

/// The metadata as text. Numbers and booleans are accepted as texts.
struct Request {
    std::string dataProviderId;
    EdfArguments providerArgs;
    /// Names what is wrong with the metadata; empty if nothing is.
    std::string invalid;
};

[[nodiscard]] Request requestOf(const pxr::VtDictionary& metadata);

/// Adds the request to a layer's arguments: `dataProviderId`, also if it is empty, and
/// `providerArgs:<key>`. Characters that separate arguments in a layer's identifier are
/// percent-encoded.
void addTo(LayerArguments& arguments, const Request& request);
/// The opposite of addTo(). Other arguments are ignored.
[[nodiscard]] Request requestOf(const LayerArguments& arguments);

/// False if a change of one opinion, from `before` to `after`, cannot change what the request says.
/// `composed` is the metadata that the request was made from.
[[nodiscard]] bool canChangeRequest(const pxr::VtValue& before, const pxr::VtValue& after,
                                    const pxr::VtDictionary& composed);

}  // namespace usdlive::edf
