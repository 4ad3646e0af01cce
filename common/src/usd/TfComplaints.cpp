// Collects the errors and warnings of Tf as text.
#include "usdlive/common/usd/TfComplaints.h"

#include <algorithm>
#include <regex>
#include <vector>

namespace usdlive::usd {

namespace {

// Removes OpenUSD's internal namespace: `pxrInternal_v0_26_8__pxrReserved__::SdfLayer` becomes
// `SdfLayer`.
std::string withoutInternalNamespace(const std::string& text) {
    static const std::regex internal("pxrInternal_\\w+__pxrReserved__::");
    return std::regex_replace(text, internal, "");
}

}  // namespace

TfComplaints::~TfComplaints() {
    if (passes_) return;
    mark_.Clear();
    trap_.Clear();
}

std::string TfComplaints::text(const std::string& otherwise) const {
    constexpr std::size_t kMost = 3;  // a full disk is reported for every block
    std::vector<std::string> distinct;
    const auto add = [&](const std::string& commentary) {
        std::string complaint = withoutInternalNamespace(commentary);
        complaint.resize(complaint.find_last_not_of('\n') + 1);
        if (distinct.size() < kMost && std::ranges::find(distinct, complaint) == distinct.end())
            distinct.push_back(complaint);
    };
    for (auto error = mark_.begin(); error != mark_.end(); ++error) add(error->GetCommentary());
    for (const auto& warning : trap_.GetWarnings()) add(warning.GetCommentary());
    std::string all;
    for (const auto& complaint : distinct) all += (all.empty() ? "" : "; ") + complaint;
    return all.empty() ? otherwise : all;
}

}  // namespace usdlive::usd
