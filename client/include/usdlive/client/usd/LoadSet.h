// Which of the layers that a layer uses are opened with it.
#pragma once

namespace usdlive::client {

/// As UsdStage::InitialLoadSet: whether layers that only payloads bring in are wanted, too.
enum class LoadSet { All, NoPayloads };

}  // namespace usdlive::client
