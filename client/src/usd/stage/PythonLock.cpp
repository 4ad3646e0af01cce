// Gives Python's lock away for a while.
#include "usd/stage/PythonLock.h"

#include <pxr/base/tf/pyLock.h>

namespace usdlive::stage {

void withoutPythonLock(const std::function<void()>& work) {
    TF_PY_ALLOW_THREADS_IN_SCOPE();
    work();
}

}  // namespace usdlive::stage
