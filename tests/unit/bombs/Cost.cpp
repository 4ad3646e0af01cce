// Measures the memory and processor time of a call.
#include "Cost.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <ctime>
#include <new>

namespace {

std::atomic<std::size_t> held = 0, highest = 0;

void* take(std::size_t size) {
    void* memory = std::malloc(size == 0 ? 1 : size);
    if (!memory) throw std::bad_alloc();
    const std::size_t now = held += malloc_usable_size(memory);
    if (now > highest) highest = now;
    return memory;
}
void give(void* memory) noexcept {
    if (memory) held -= malloc_usable_size(memory);
    std::free(memory);
}

std::chrono::milliseconds processorTime() {
    return std::chrono::milliseconds(std::clock() * 1000 / CLOCKS_PER_SEC);
}

}  // namespace

void* operator new(std::size_t size) { return take(size); }
void* operator new[](std::size_t size) { return take(size); }
void operator delete(void* memory) noexcept { give(memory); }
void operator delete[](void* memory) noexcept { give(memory); }
void operator delete(void* memory, std::size_t) noexcept { give(memory); }
void operator delete[](void* memory, std::size_t) noexcept { give(memory); }

namespace usdlive::bombs {

Cost costOf(const std::function<void()>& call) {
    const std::size_t before = highest = held.load();
    const auto start = processorTime();
    call();
    return {highest - before, processorTime() - start};
}

}  // namespace usdlive::bombs
