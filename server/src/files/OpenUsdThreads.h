// The threads of OpenUSD.
#pragma once

#include <functional>

namespace usdlive::server {

/// Calls `work` so that OpenUSD uses the caller's thread only. OpenUSD and its library for parallel
/// work (TBB) end the process when the system refuses them a thread. Files are read and written in
/// parallel by workers all the same. (pxr::WorkSetConcurrencyLimit() counts on one thread only.)
void withoutThreadsOfOpenUsd(const std::function<void()>& work);

}  // namespace usdlive::server
