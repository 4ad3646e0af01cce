#pragma once

#include <pxr/base/tf/diagnosticTrap.h>
#include <pxr/base/tf/errorMark.h>

#include <string>

namespace usdlive::usd {

/// Keeps what Tf reports on this thread while it lives from being printed, and tells it.
class TfComplaints {
public:
    TfComplaints() = default;
    ~TfComplaints();
    TfComplaints(const TfComplaints&) = delete;
    TfComplaints& operator=(const TfComplaints&) = delete;

    [[nodiscard]] bool hasErrors() const { return !mark_.IsClean(); }
    /// The first errors and warnings, one after the other; `otherwise` when there are none.
    [[nodiscard]] std::string text(const std::string& otherwise) const;

private:
    // Warnings reach the trap at once, errors stay in the mark within it.
    pxr::TfDiagnosticTrap trap_;
    pxr::TfErrorMark mark_;
};

}  // namespace usdlive::usd
