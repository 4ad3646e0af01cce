// Gives Python's lock away for a while. Built with Python support, without which Tf's macro is
// empty.
#include "usd/stage/PythonLock.h"

#include <pxr/base/tf/pyLock.h>

#ifndef PXR_PYTHON_SUPPORT_ENABLED
#error "Tf would keep the lock"
#endif

namespace usdlive::stage {

void withoutPythonLock(const std::function<void()>& work) {
    TF_PY_ALLOW_THREADS_IN_SCOPE();
    work();
}

}  // namespace usdlive::stage
