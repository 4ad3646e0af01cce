// Turns the editor's writes into one layer into edits.
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
/// Changes of the namespace are recorded in order. Of all other changes only the place is recorded,
/// and seal() reads the final content there. A value that was set a hundred times in a frame is one
/// edit; a value that was set back is none.
///
/// Used by the thread that owns the layer. Writes of other threads are refused: each causes an
/// error of Tf, which Python raises there; seal() reverts them and returns them as lost. Between
/// two calls of seal() only the editor may change the layer.
class Capture final : public usd::LayerWriteObserver {
public:
    /// `view` returns the session's view of the layer (Session::view()). `begun` is called by the
    /// writing thread when hasWrites() becomes true. `clips` and `layers` are called with the asset
    /// paths of value clips and of layers that are written, before the layer has changed.
    using Named = std::function<void(const std::set<std::string>&)>;
    Capture(
        LayerId layer, std::function<const LayerDoc*()> view, std::function<void()> begun = [] {},
        Named clips = [](const auto&) {}, Named layers = [](const auto&) {});

    [[nodiscard]] bool hasWrites() const;

    /// A write that cannot be shared. The layer has the content of the session there again.
    struct LostWrite {
        std::string path;
        std::string field;                ///< empty: the spec itself is meant
        Error reason;                     ///< names layer, path, field and type
        std::vector<AuthoredEdit> edits;  ///< the written edits, as far as they can be expressed
    };
    struct Sealed {
        std::vector<AuthoredEdit> edits;  ///< in order; each is valid after the ones before
        std::vector<LostWrite> lost;
    };
    /// Ends a frame: returns the edits that were written since the last call. Precondition: the
    /// call does not come from within Sdf. `store` is that of the layer. Big values are passed to
    /// `blobs`.
    [[nodiscard]] Sealed seal(usd::SdfLayerStore& store, BlobSink& blobs);

    /// Forgets the writes since the last seal().
    void discard();
    /// Call it when the content was replaced without notices of single writes: seal() compares the
    /// whole layer.
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
    void placeMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) override;
    void clipsWritten(const pxr::VtValue& value) override;
    void layersNamed(const std::set<std::string>& assets) override;

    /// Appends the arrays that were written since the last seal() and take long to encode: the last
    /// one of each register. They share memory with the layer.
    static constexpr std::size_t kBigArrayBytes = std::size_t(4) << 20;
    void appendBigArrays(std::vector<pxr::VtValue>& arrays) const;

private:
    struct DirtyField {
        bool whole = false;  // compare everything; the two members below are unused
        std::set<pxr::TfToken> keyPaths;
        std::set<double> times;
    };
    struct DirtySpec {
        std::map<pxr::TfToken, DirtyField> fields;
        std::array<bool, 4> lists{};  // by ChildList: the order may have changed
    };
    class Sealing;

    void begin();
    Result<void> record(std::string_view path, EditAction action);
    bool dropBelow(std::string_view path);
    void forgetBelow(const pxr::SdfPath& path);
    void carry(const pxr::SdfPath& from, const pxr::SdfPath& to);
    void noteForeign(const pxr::SdfPath& path, const std::string& field, const std::string& what);

    [[nodiscard]] bool isForeign();

    const LayerId layer_;
    const std::function<const LayerDoc*()> view_;
    const std::function<void()> begun_;
    const Named clips_, layers_;
    const std::thread::id thread_ = std::this_thread::get_id();  // the thread that owns the layer
    std::atomic<bool> foreign_ = false;  // another thread has written since the last seal()
    // The session's view with edits_ applied to it. Set from the first write to seal().
    std::optional<LayerDoc> working_;
    // Specs of working_ with this id or a higher one were created since the last seal().
    NodeId firstNew_ = 0;
    std::vector<AuthoredEdit> edits_;
    // The places that seal() compares. Ordered by SdfPath, which sorts a spec directly before the
    // specs below it.
    std::map<pxr::SdfPath, DirtySpec> dirty_;
    // Specs for which the notices contradict the working copy: seal() compares them with everything
    // below.
    std::set<pxr::SdfPath> unclear_;
    std::vector<LostWrite> lost_;
    using Register = std::tuple<pxr::SdfPath, pxr::TfToken, std::optional<double>>;
    std::map<Register, pxr::VtValue> bigArrays_;
};

}  // namespace usdlive::client
