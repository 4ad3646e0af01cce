// References and notifications between the parts of a project.
#pragma once

#include <vector>

namespace usdlive::server {

/// A part's reference to another part, to a port or to the options. Assigning a part copies its
/// state but not its references, so that a project can be assigned to another one. tests/model
/// assigns thousands of them.
template <class T>
class Wire {
public:
    Wire(T& target) : target_(&target) {}
    Wire(const Wire&) = default;
    Wire& operator=(const Wire&) { return *this; }

    [[nodiscard]] T* operator->() const { return target_; }
    [[nodiscard]] T& operator*() const { return *target_; }

private:
    T* target_;
};

/// The listeners of a part, notified in the order in which they were added. Assignment does not
/// copy them.
template <class Listener>
class Listeners {
public:
    Listeners() = default;
    Listeners(const Listeners&) = delete;
    Listeners& operator=(const Listeners&) { return *this; }

    void add(Listener& listener) { listeners_.push_back(&listener); }
    /// Calls the function with these arguments on each listener.
    template <class... Parameters, class... Arguments>
    void notify(void (Listener::*function)(Parameters...), const Arguments&... arguments) const {
        for (Listener* listener : listeners_) (listener->*function)(arguments...);
    }

private:
    std::vector<Listener*> listeners_;
};

}  // namespace usdlive::server
