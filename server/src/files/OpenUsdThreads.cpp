// Keeps OpenUSD from starting threads.
#include "files/OpenUsdThreads.h"

#include <tbb/task_arena.h>

namespace usdlive::server {

void withoutThreadsOfOpenUsd(const std::function<void()>& work) {
    tbb::task_arena ownThread(1);
    ownThread.execute(work);
}

}  // namespace usdlive::server
