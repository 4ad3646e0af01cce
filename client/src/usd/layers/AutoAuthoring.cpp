// Shows auto authoring to users, and lends the delegate what they clear.
#include "usdlive/client/usd/layers/AutoAuthoring.h"

#include <pxr/usd/sdf/changeBlock.h>

#include <ranges>

#include "usd/layers/DelegateAuthoring.h"
#include "usd/layers/Distribution.h"

namespace usdlive::layers {

bool AutoAuthoring::isEnabled() const { return bool(authoring_.delegate()); }

LayerResult<void> AutoAuthoring::setDefaultLayer(const std::string& identifier) {
    return authoring_.setDefaultLayer(identifier);
}

std::string AutoAuthoring::defaultLayer() { return authoring_.defaultLayer(); }

bool AutoAuthoring::isAutoAuthoringLayer(const std::string& identifier) const {
    return DelegateAuthoring::isDelegate(identifier);
}

void AutoAuthoring::suspend() { authoring_.suspend(); }
void AutoAuthoring::resume() { authoring_.resume(); }
bool AutoAuthoring::isSuspended() const { return authoring_.isSuspended(); }

class Clearing::Impl {
public:
    Impl(const DelegateAuthoring& authoring, const std::vector<pxr::SdfPath>& specs,
         std::optional<double> time)
        : delegate_(authoring.delegate()),
          writes_(authoring.writes()),
          distribution_(authoring.distribution()) {
        const DelegateWrites::Ignoring ignoring(*writes_);
        for (const auto& path : specs) lent_.push_back(distribution_.lend(path, time, *writes_));
    }
    ~Impl() {
        const DelegateWrites::Ignoring ignoring(*writes_);
        for (const auto& lent : lent_ | std::views::reverse) distribution_.takeBack(lent, *writes_);
    }

private:
    const pxr::SdfChangeBlock block_;
    // The mode may end meanwhile.
    const pxr::SdfLayerRefPtr delegate_;
    const pxr::TfRefPtr<DelegateWrites> writes_;
    Distribution distribution_;
    std::vector<Distribution::Lent> lent_;
};

Clearing::Clearing(AutoAuthoring& authoring, const std::vector<pxr::SdfPath>& specs,
                   std::optional<double> time)
    : impl_(authoring.isEnabled() ? std::make_unique<Impl>(authoring.authoring_, specs, time)
                                  : nullptr) {}
Clearing::~Clearing() = default;

}  // namespace usdlive::layers
