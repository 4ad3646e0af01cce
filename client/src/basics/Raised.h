// Sets a flag within a scope.
#pragma once

namespace usdlive::client {

/// Sets a flag for its lifetime, also if a callback of the editor throws.
class Raised {
public:
    explicit Raised(bool& flag) : flag_(flag) { flag_ = true; }
    ~Raised() { flag_ = false; }
    Raised(const Raised&) = delete;
    Raised& operator=(const Raised&) = delete;

private:
    bool& flag_;
};

}  // namespace usdlive::client
