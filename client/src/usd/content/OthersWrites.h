// Knows what others have written into a layer since a moment, for undo.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <map>
#include <memory>
#include <string>

#include "usdlive/client/usd/content/Registers.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::content {

/// The last revision in which another client has written each spec and register of a live layer.
///
/// A Recorder creates it and its Record keeps it. The client that shares the layer notes commits
/// for as long as it exists. Used by the thread of the layer.
class OthersWrites {
public:
    /// Above this number of registers, all of the layer counts as written by others.
    static constexpr std::size_t kMostRegisters = 100'000;

    /// Returns the object of the layer, and creates it if there is none.
    static std::shared_ptr<OthersWrites> of(const pxr::SdfLayerHandle& layer);
    /// Returns nullptr if nobody keeps an object of the layer.
    static std::shared_ptr<OthersWrites> find(const pxr::SdfLayerHandle& layer);

    /// Notes a committed edit of another client.
    void note(const Edit& edit, Revision revision);
    /// Notes a committed edit of this client. Others' writes after its `base` were committed before
    /// it, so that this client is the last writer.
    void noteOwn(const Edit& edit, Revision base);

    /// Notes that the layer was joined again at `revision`, without the commits before it. Nobody
    /// knows what others have written meanwhile.
    void missed(Revision revision) { missed_ = last_ = revision; }

    /// The last revision in which another client has written the layer.
    [[nodiscard]] Revision last() const { return last_; }
    /// Returns whether others have created, deleted or moved the spec after `revision`.
    [[nodiscard]] bool changedSpec(const pxr::SdfPath& path, Revision revision) const;
    /// Returns whether others have written the spec or a field of it after `revision`.
    [[nodiscard]] bool wroteSpec(const pxr::SdfPath& path, Revision revision) const;
    /// Returns whether others have written the register, or created its spec, after `revision`.
    [[nodiscard]] bool wroteRegister(const Change& change, Revision revision) const;

    /// Returns whether commits after `revision` were not noted.
    [[nodiscard]] bool hasMissed(Revision revision) const { return missed_ > revision; }

private:
    using Registers = std::map<std::string, Revision>;  // by field and part; "": the spec itself

    void follow(const std::string& from, const std::string& to);
    void noteAt(const std::string& path, std::string key, Revision revision);
    [[nodiscard]] bool wrote(const pxr::SdfPath& path, const std::string& key,
                             Revision revision) const;

    std::map<std::string, Registers> specs_;
    std::size_t count_ = 0;
    Revision all_ = 0;  // others count as writers of everything up to here
    Revision last_ = 0;
    Revision missed_ = 0;
};

}  // namespace usdlive::content
