// Captures the errors and warnings of Tf.
#pragma once

#include <pxr/base/tf/diagnosticTrap.h>
#include <pxr/base/tf/errorMark.h>

#include <string>

namespace usdlive::usd {

/// Captures the errors and warnings that Tf reports on this thread during its lifetime. They are
/// not printed, unless pass() is called.
class TfComplaints {
public:
    TfComplaints() = default;
    ~TfComplaints();
    TfComplaints(const TfComplaints&) = delete;
    TfComplaints& operator=(const TfComplaints&) = delete;

    [[nodiscard]] bool hasErrors() const { return !mark_.IsClean(); }
    /// Returns the first errors and warnings, or `otherwise` if there are none.
    [[nodiscard]] std::string text(const std::string& otherwise) const;
    /// Lets the destructor report them as if they had not been captured.
    void pass() { passes_ = true; }

private:
    // The trap receives warnings at once; errors stay in the mark inside it.
    pxr::TfDiagnosticTrap trap_;
    pxr::TfErrorMark mark_;
    bool passes_ = false;
};

}  // namespace usdlive::usd
