// Finds out who has made the opinions of a spec.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// An opinion of the present, and the last edit that made it what it is.
struct BlamedOpinion {
    std::string path;       ///< now
    std::string field;      ///< empty: the spec itself, with its name and parent
    FieldPart part;         ///< std::monostate: the whole field
    Revision revision = 0;  ///< 0: not found, it is older than all commits that were passed
    UserName user;
    std::int64_t timeMs = 0;  ///< milliseconds since 1970
    bool isImport = false;    ///< it came from the layer's file
    std::string pathThen;     ///< before the commit; empty if the commit has created the spec
};

/// Looks for the authors of the opinions in a layer. Pass it the commits, the newest first, until
/// it has found all. Specs are followed through renames into the past.
class Blame {
public:
    /// How much of the layer to look at: a spec with its properties, or with everything below it.
    enum class Depth { Spec, Below };
    /// `present`: the layer after the newest commit, with a spec at `path`.
    Blame(const LayerDoc& present, LayerId layer, std::string_view path, Depth depth);
    /// Looks at one field only, part by part: each time sample, dictionary key and list item.
    /// Precondition: the spec has the field.
    Blame(const LayerDoc& present, LayerId layer, const std::string& path,
          const std::string& field);

    void add(const Commit& commit);
    [[nodiscard]] bool isComplete() const { return open_.empty(); }
    /// In the order of the layer: specs before what is below them, fields by name.
    [[nodiscard]] const std::vector<BlamedOpinion>& opinions() const { return opinions_; }

private:
    void want(std::string path, std::string field, FieldPart part);
    void goBefore(const Commit& commit, const Edit& edit);
    void followRecent(const Edit& edit);
    template <class Fits>
    void found(const Commit& commit, const std::string& path, std::string_view pathThen,
               const Fits& fits);

    const LayerId layer_;
    std::vector<BlamedOpinion> opinions_;
    std::map<std::string, std::vector<std::size_t>, std::less<>> open_;  // by the path of then
    std::vector<std::size_t> recent_;  // found in the commit that is being passed
};

}  // namespace usdlive
