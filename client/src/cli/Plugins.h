// OpenUSD's plug-ins beside this program.
#pragma once

namespace usdlive::cli {

/// Registers usdlive's plug-ins: schemas, file formats and the resolver of usdlive:// addresses.
/// Those that PXR_PLUGINPATH_NAME names stay. Call it before the first layer is opened.
void registerPlugins();

}  // namespace usdlive::cli
