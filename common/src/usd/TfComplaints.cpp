#include "usdlive/common/usd/TfComplaints.h"

#include <algorithm>
#include <vector>

namespace usdlive::usd {

TfComplaints::~TfComplaints() {
    mark_.Clear();
    trap_.Clear();
}

std::string TfComplaints::text(const std::string& otherwise) const {
    constexpr std::size_t kMost = 3;  // a full disk is complained of for every block
    std::vector<std::string> told;
    const auto add = [&](const std::string& complaint) {
        if (told.size() < kMost && std::ranges::find(told, complaint) == told.end())
            told.push_back(complaint);
    };
    for (auto error = mark_.begin(); error != mark_.end(); ++error) add(error->GetCommentary());
    for (const auto& warning : trap_.GetWarnings()) add(warning.GetCommentary());
    std::string all;
    for (const auto& complaint : told) all += (all.empty() ? "" : "; ") + complaint;
    return all.empty() ? otherwise : all;
}

}  // namespace usdlive::usd
