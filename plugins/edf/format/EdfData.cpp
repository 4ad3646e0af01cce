// Reads the deferred parts of a layer's data when they are needed.
#include "EdfData.h"

#include <pxr/usd/sdf/schema.h>

namespace usdlive::edf {

using pxr::SdfData;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Copies specs with their fields; calls nothing of the target that would read deferred parts.
class PartCopy final : public pxr::SdfAbstractDataSpecVisitor {
public:
    explicit PartCopy(SdfData& target, void (*create)(SdfData&, const SdfPath&, pxr::SdfSpecType),
                      void (*set)(SdfData&, const SdfPath&, const TfToken&, const VtValue&))
        : target_(target), create_(create), set_(set) {}

    bool VisitSpec(const pxr::SdfAbstractData& source, const SdfPath& path) override {
        create_(target_, path, source.GetSpecType(path));
        for (const TfToken& field : source.List(path))
            set_(target_, path, field, source.Get(path, field));
        return true;
    }
    void Done(const pxr::SdfAbstractData&) override {}

private:
    SdfData& target_;
    void (*create_)(SdfData&, const SdfPath&, pxr::SdfSpecType);
    void (*set_)(SdfData&, const SdfPath&, const TfToken&, const VtValue&);
};

}  // namespace

void EdfData::defer(const pxr::SdfPathSet& prims, ReadPart read) {
    if (prims.empty()) return;
    read_ = std::move(read);
    isStreaming_ = true;
    add({{}, prims});
}

void EdfData::add(const Part& part) {
    PartCopy copy(
        *this,
        [](SdfData& data, const SdfPath& path, pxr::SdfSpecType type) {
            data.SdfData::CreateSpec(path, type);
        },
        [](SdfData& data, const SdfPath& path, const TfToken& field, const VtValue& value) {
            data.SdfData::Set(path, field, value);
        });
    if (part.specs) part.specs->VisitSpecs(&copy);
    for (const SdfPath& path : part.deferred) deferred_.emplace(path, State::Waiting);
    pending_ = deferred_.size();
}

// Reads one deferred prim, or waits until another thread has read it.
void EdfData::readPart(const SdfPath& prim) const {
    std::unique_lock lock(deferredMutex_);
    const auto found = deferred_.find(prim);
    if (found == deferred_.end()) return;
    if (found->second == State::Reading) {
        ended_.wait(lock, [&] { return !deferred_.contains(prim); });
        return;
    }
    found->second = State::Reading;
    lock.unlock();
    const Part part = read_(prim);

    const std::unique_lock content(content_);
    lock.lock();
    deferred_.erase(prim);
    const_cast<EdfData*>(this)->add(part);
    ended_.notify_all();
}

void EdfData::need(const SdfPath& path, Needs needs) const {
    // From the root down, because reading a prim can make its children deferred.
    const SdfPath prim = path.GetAbsoluteRootOrPrimPath();
    for (const SdfPath& prefix : prim.GetPrefixes()) {
        const bool isDeferred = [&] {
            const std::lock_guard lock(deferredMutex_);
            return deferred_.contains(prefix);
        }();
        if (!isDeferred || (prefix == prim && (needs == Needs::Spec || prim != path))) continue;
        if (isPostponed_ && isPostponed_()) return;
        readPart(prefix);
    }
}

void EdfData::readAll() const {
    while (pending_ > 0) {
        const SdfPath next = [&] {
            const std::lock_guard lock(deferredMutex_);
            return deferred_.empty() ? SdfPath() : deferred_.begin()->first;
        }();
        if (!next.IsEmpty()) readPart(next);
    }
}

template <class Read>
auto EdfData::reading(const SdfPath& path, Needs needs, Read read) const {
    if (pending_ == 0) return read();
    need(path, needs);
    const std::shared_lock lock(content_);
    return read();
}

template <class Write>
void EdfData::writing(const SdfPath& path, Write write) {
    if (pending_ == 0) return write();
    need(path, Needs::Children);
    const std::unique_lock lock(content_);
    write();
}

bool EdfData::IsEmpty() const {
    return reading(SdfPath::AbsoluteRootPath(), Needs::Spec,
                   [&] { return !SdfData::HasSpec(SdfPath::AbsoluteRootPath()); });
}

void EdfData::CreateSpec(const SdfPath& path, pxr::SdfSpecType type) {
    writing(path, [&] { SdfData::CreateSpec(path, type); });
}

bool EdfData::HasSpec(const SdfPath& path) const {
    return reading(path, Needs::Spec, [&] { return SdfData::HasSpec(path); });
}

void EdfData::EraseSpec(const SdfPath& path) {
    writing(path, [&] { SdfData::EraseSpec(path); });
}

void EdfData::MoveSpec(const SdfPath& from, const SdfPath& to) {
    readAll();
    SdfData::MoveSpec(from, to);
}

pxr::SdfSpecType EdfData::GetSpecType(const SdfPath& path) const {
    return reading(path, Needs::Spec, [&] { return SdfData::GetSpecType(path); });
}

namespace {

bool isListOfChildren(const TfToken& field) { return field == pxr::SdfChildrenKeys->PrimChildren; }

}  // namespace

bool EdfData::Has(const SdfPath& path, const TfToken& field,
                  pxr::SdfAbstractDataValue* value) const {
    return reading(path, isListOfChildren(field) ? Needs::Children : Needs::Spec,
                   [&] { return SdfData::Has(path, field, value); });
}

bool EdfData::Has(const SdfPath& path, const TfToken& field, VtValue* value) const {
    return reading(path, isListOfChildren(field) ? Needs::Children : Needs::Spec,
                   [&] { return SdfData::Has(path, field, value); });
}

bool EdfData::HasSpecAndField(const SdfPath& path, const TfToken& field,
                              pxr::SdfAbstractDataValue* value, pxr::SdfSpecType* type) const {
    return reading(path, isListOfChildren(field) ? Needs::Children : Needs::Spec,
                   [&] { return SdfData::HasSpecAndField(path, field, value, type); });
}

bool EdfData::HasSpecAndField(const SdfPath& path, const TfToken& field, VtValue* value,
                              pxr::SdfSpecType* type) const {
    return reading(path, isListOfChildren(field) ? Needs::Children : Needs::Spec,
                   [&] { return SdfData::HasSpecAndField(path, field, value, type); });
}

VtValue EdfData::Get(const SdfPath& path, const TfToken& field) const {
    return reading(path, isListOfChildren(field) ? Needs::Children : Needs::Spec,
                   [&] { return SdfData::Get(path, field); });
}

void EdfData::Set(const SdfPath& path, const TfToken& field, const VtValue& value) {
    writing(path, [&] { SdfData::Set(path, field, value); });
}

void EdfData::Set(const SdfPath& path, const TfToken& field,
                  const pxr::SdfAbstractDataConstValue& value) {
    writing(path, [&] { SdfData::Set(path, field, value); });
}

void EdfData::Erase(const SdfPath& path, const TfToken& field) {
    writing(path, [&] { SdfData::Erase(path, field); });
}

std::vector<TfToken> EdfData::List(const SdfPath& path) const {
    return reading(path, Needs::Children, [&] { return SdfData::List(path); });
}

std::set<double> EdfData::ListAllTimeSamples() const {
    readAll();
    return SdfData::ListAllTimeSamples();
}

std::set<double> EdfData::ListTimeSamplesForPath(const SdfPath& path) const {
    return reading(path, Needs::Spec, [&] { return SdfData::ListTimeSamplesForPath(path); });
}

bool EdfData::GetBracketingTimeSamples(double time, double* lower, double* upper) const {
    readAll();
    return SdfData::GetBracketingTimeSamples(time, lower, upper);
}

std::size_t EdfData::GetNumTimeSamplesForPath(const SdfPath& path) const {
    return reading(path, Needs::Spec, [&] { return SdfData::GetNumTimeSamplesForPath(path); });
}

bool EdfData::GetBracketingTimeSamplesForPath(const SdfPath& path, double time, double* lower,
                                              double* upper) const {
    return reading(path, Needs::Spec, [&] {
        return SdfData::GetBracketingTimeSamplesForPath(path, time, lower, upper);
    });
}

bool EdfData::GetPreviousTimeSampleForPath(const SdfPath& path, double time,
                                           double* previous) const {
    return reading(path, Needs::Spec,
                   [&] { return SdfData::GetPreviousTimeSampleForPath(path, time, previous); });
}

bool EdfData::QueryTimeSample(const SdfPath& path, double time,
                              pxr::SdfAbstractDataValue* value) const {
    return reading(path, Needs::Spec, [&] { return SdfData::QueryTimeSample(path, time, value); });
}

bool EdfData::QueryTimeSample(const SdfPath& path, double time, VtValue* value) const {
    return reading(path, Needs::Spec, [&] { return SdfData::QueryTimeSample(path, time, value); });
}

void EdfData::SetTimeSample(const SdfPath& path, double time, const VtValue& value) {
    writing(path, [&] { SdfData::SetTimeSample(path, time, value); });
}

void EdfData::EraseTimeSample(const SdfPath& path, double time) {
    writing(path, [&] { SdfData::EraseTimeSample(path, time); });
}

void EdfData::_VisitSpecs(pxr::SdfAbstractDataSpecVisitor* visitor) const {
    readAll();
    SdfData::_VisitSpecs(visitor);
}

}  // namespace usdlive::edf
