#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>

#include <array>
#include <atomic>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <vector>

#include "session/Session.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::client {

/// Turns what an editor writes into one live layer into the edits of a transaction.
///
/// What happens to the namespace is taken in the order it happens. Of everything else only the
/// place is noted: seal() reads what stands there in the end, so a value that was set a hundred
/// times in a frame is one edit, and one that was set back is none.
///
/// Used by the thread that owns the layer. Writes of other threads are refused: seal() takes them
/// back and returns them as lost. Between two seals nothing but the editor may change it.
class Capture final : public usd::LayerWriteObserver {
public:
    /// `view` gives what the session shows of the layer, see Session::view(). `begun` is called,
    /// by whatever thread writes, when hasWrites() becomes true.
    Capture(
        LayerId layer, std::function<const LayerDoc*()> view, std::function<void()> begun = [] {});

    [[nodiscard]] bool hasWrites() const;

    /// A write that cannot be shared; the layer is back at what the session has there.
    struct LostWrite {
        std::string path;
        std::string field;                ///< empty: the spec itself
        Error reason;                     ///< names layer, path, field and type
        std::vector<AuthoredEdit> edits;  ///< what was written, as far as it can be expressed
    };
    struct Sealed {
        std::vector<AuthoredEdit> edits;  ///< each valid after the ones before
        std::vector<LostWrite> lost;
    };
    /// What was written since the last call. Precondition: the layer is at rest, i.e. the call does
    /// not come from within Sdf. `store` is the layer's; big values go to `blobs`.
    [[nodiscard]] Sealed seal(usd::SdfLayerStore& store, usd::BlobSink& blobs);

    /// Forgets what was written since the last seal.
    void discard();
    /// The layer was replaced in a way that told nothing of the single writes: seal() compares it
    /// whole.
    void contentReplaced();

    void specCreated(const pxr::SdfPath& path, pxr::SdfSpecType type) override;
    void specDeleted(const pxr::SdfPath& path) override;
    void specMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) override;
    void childrenChanged(const pxr::SdfPath& parent, const pxr::TfToken& field,
                         bool appended) override;
    void fieldChanged(const pxr::SdfPath& path, const pxr::TfToken& field) override;
    void dictionaryKeyChanged(const pxr::SdfPath& path, const pxr::TfToken& field,
                              const pxr::TfToken& keyPath) override;
    void timeSampleChanged(const pxr::SdfPath& path, double time) override;
    void arrayWritten(const pxr::SdfPath& path, const pxr::TfToken& field,
                      std::optional<double> time, const pxr::VtValue& array) override;

    /// Arrays that were written since the last seal and take a part of a frame to encode: the last
    /// of each register. They share the memory of what the layer holds.
    static constexpr std::size_t kBigArrayBytes = std::size_t(4) << 20;
    void appendBigArrays(std::vector<pxr::VtValue>& arrays) const;

private:
    struct DirtyField {
        bool whole = false;  // then the two below say nothing more
        std::set<pxr::TfToken> keyPaths;
        std::set<double> times;
    };
    struct DirtySpec {
        std::map<pxr::TfToken, DirtyField> fields;
        std::array<bool, 4> lists{};  // by ChildList: the order has to be compared
    };
    class Sealing;

    void begin();
    [[nodiscard]] Result<void> check(std::string_view path, const EditAction& action) const;
    Result<void> record(std::string_view path, EditAction action);
    bool dropBelow(std::string_view path);
    void forgetBelow(const pxr::SdfPath& path);
    void carry(const pxr::SdfPath& from, const pxr::SdfPath& to);
    void noteForeign(const pxr::SdfPath& path, const std::string& field, const std::string& what);

    [[nodiscard]] bool isForeign();

    const LayerId layer_;
    const std::function<const LayerDoc*()> view_;
    const std::function<void()> begun_;
    const std::thread::id thread_ = std::this_thread::get_id();  // that owns the layer
    std::atomic<bool> foreign_ = false;  // another thread has written since the last seal
    // The session's view with edits_ applied to it; there from the first write to the seal.
    std::optional<LayerDoc> working_;
    NodeId firstNew_ = 0;  // of working_: specs from here on were created since the last seal
    std::vector<AuthoredEdit> edits_;
    // Where to look at the seal. By SdfPath, which sorts a spec right before all that is below it.
    std::map<pxr::SdfPath, DirtySpec> dirty_;
    // Specs that events and working copy disagree about: compared whole, with all below.
    std::set<pxr::SdfPath> unclear_;
    std::vector<LostWrite> lost_;
    using Register = std::tuple<pxr::SdfPath, pxr::TfToken, std::optional<double>>;
    std::map<Register, pxr::VtValue> bigArrays_;
};

}  // namespace usdlive::client
