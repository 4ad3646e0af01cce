// Gives Python's lock away for a while.
#pragma once

#include <functional>

namespace usdlive::stage {

/// Calls `work`. While it runs, this thread does not hold Python's lock, if it had it: the threads
/// of OpenUSD for which `work` waits may need it, for example for a layer that only Python holds.
void withoutPythonLock(const std::function<void()>& work);

}  // namespace usdlive::stage
