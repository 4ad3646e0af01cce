// The data of a layer of the format, parts of which may be read when they are first needed.
#pragma once

#include <pxr/usd/sdf/data.h>

#include <atomic>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <shared_mutex>
#include <string>
#include <utility>
#include <vector>

namespace usdlive::edf {

/// SdfData, with prims whose children are read by a function when somebody asks for them, or for
/// what contains them: the list of fields of the prim, a path below it, all specs (export, flatten,
/// transfer).
///
/// Any number of threads may read at the same time, as of SdfData. The first that needs a deferred
/// prim reads it; others that need the same one wait; the rest go on. As soon as nothing is
/// deferred any more, this is an SdfData without any lock.
class EdfData final : public pxr::SdfData {
public:
    /// The content below one prim: specs, and those of them whose children are deferred in turn.
    struct Part {
        pxr::SdfDataRefPtr specs;
        pxr::SdfPathSet deferred;
    };
    /// Reads the children of a prim. Never fails: after an error the part is empty.
    using ReadPart = std::function<Part(const pxr::SdfPath& prim)>;

    /// Defers the children of these prims. Called before the layer gets the data.
    void defer(const pxr::SdfPathSet& prims, ReadPart read);
    /// Returns true if a deferred part must not be read now: it is treated as empty then.
    using IsPostponed = std::function<bool()>;
    /// Sets what is asked before a part is read for one path. Called before the layer gets the
    /// data. What needs all parts, such as an export, does not ask.
    void setPostponed(IsPostponed isPostponed) { isPostponed_ = std::move(isPostponed); }
    /// Reads all deferred parts.
    void readAll() const;

    /// The origin of the content.
    struct Sources {
        std::set<std::string> files;
        bool isRead = false;     ///< false for a layer that is new, or could not be read
        bool mayChange = false;  ///< without a change of a file: a reload always reads again
    };
    void setSources(Sources sources) { sources_ = std::move(sources); }
    [[nodiscard]] const Sources& sources() const { return sources_; }

    // SdfAbstractData
    bool StreamsData() const override { return isStreaming_; }
    bool IsDetached() const override { return pending_ == 0; }
    bool IsEmpty() const override;
    void CreateSpec(const pxr::SdfPath& path, pxr::SdfSpecType type) override;
    bool HasSpec(const pxr::SdfPath& path) const override;
    void EraseSpec(const pxr::SdfPath& path) override;
    void MoveSpec(const pxr::SdfPath& from, const pxr::SdfPath& to) override;
    pxr::SdfSpecType GetSpecType(const pxr::SdfPath& path) const override;
    bool Has(const pxr::SdfPath& path, const pxr::TfToken& field,
             pxr::SdfAbstractDataValue* value) const override;
    bool Has(const pxr::SdfPath& path, const pxr::TfToken& field,
             pxr::VtValue* value) const override;
    bool HasSpecAndField(const pxr::SdfPath& path, const pxr::TfToken& field,
                         pxr::SdfAbstractDataValue* value, pxr::SdfSpecType* type) const override;
    bool HasSpecAndField(const pxr::SdfPath& path, const pxr::TfToken& field, pxr::VtValue* value,
                         pxr::SdfSpecType* type) const override;
    pxr::VtValue Get(const pxr::SdfPath& path, const pxr::TfToken& field) const override;
    void Set(const pxr::SdfPath& path, const pxr::TfToken& field,
             const pxr::VtValue& value) override;
    void Set(const pxr::SdfPath& path, const pxr::TfToken& field,
             const pxr::SdfAbstractDataConstValue& value) override;
    void Erase(const pxr::SdfPath& path, const pxr::TfToken& field) override;
    std::vector<pxr::TfToken> List(const pxr::SdfPath& path) const override;
    std::set<double> ListAllTimeSamples() const override;
    std::set<double> ListTimeSamplesForPath(const pxr::SdfPath& path) const override;
    bool GetBracketingTimeSamples(double time, double* lower, double* upper) const override;
    std::size_t GetNumTimeSamplesForPath(const pxr::SdfPath& path) const override;
    bool GetBracketingTimeSamplesForPath(const pxr::SdfPath& path, double time, double* lower,
                                         double* upper) const override;
    bool GetPreviousTimeSampleForPath(const pxr::SdfPath& path, double time,
                                      double* previous) const override;
    bool QueryTimeSample(const pxr::SdfPath& path, double time,
                         pxr::SdfAbstractDataValue* value) const override;
    bool QueryTimeSample(const pxr::SdfPath& path, double time, pxr::VtValue* value) const override;
    void SetTimeSample(const pxr::SdfPath& path, double time, const pxr::VtValue& value) override;
    void EraseTimeSample(const pxr::SdfPath& path, double time) override;

protected:
    void _VisitSpecs(pxr::SdfAbstractDataSpecVisitor* visitor) const override;

private:
    enum class Needs { Spec, Children };
    // Reads what is deferred above `path` and, with Children, below it. Then calls `read` while no
    // part is added.
    template <class Read>
    auto reading(const pxr::SdfPath& path, Needs needs, Read read) const;
    template <class Write>
    void writing(const pxr::SdfPath& path, Write write);
    void need(const pxr::SdfPath& path, Needs needs) const;
    void readPart(const pxr::SdfPath& prim) const;
    void add(const Part& part);

    ReadPart read_;
    IsPostponed isPostponed_;
    bool isStreaming_ = false;
    Sources sources_;

    // Reading parts is no change of what the data says, so all of this is mutable.
    mutable std::shared_mutex content_;  // the base class, while pending_ > 0
    mutable std::mutex deferredMutex_;   // guards deferred_
    mutable std::condition_variable ended_;
    enum class State { Waiting, Reading };
    mutable std::map<pxr::SdfPath, State> deferred_;
    mutable std::atomic<std::size_t> pending_ =
        0;  // the size of deferred_; nothing is added once it is 0
};

using EdfDataRefPtr = pxr::TfRefPtr<EdfData>;

}  // namespace usdlive::edf
