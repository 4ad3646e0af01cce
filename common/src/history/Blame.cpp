// Finds out who has made the opinions of a spec.
#include "usdlive/common/history/Blame.h"

#include <iterator>
#include <utility>
#include <variant>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/layer/FieldValue.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

// The parts of a composite field; none for a plain value. Dictionaries within are parts as a whole.
std::vector<FieldPart> partsOf(const FieldValue& field) {
    std::vector<FieldPart> parts;
    field.visit(Overloaded{[](const Value&) {},
                           [&](const Dictionary& value) {
                               for (const auto& [key, entry] : value.entries)
                                   parts.push_back(DictionaryKey{{key}});
                           },
                           [&](const TimeSamples& value) {
                               for (const auto& [time, sample] : value.samples)
                                   parts.push_back(SampleTime{time});
                           },
                           [&](const ListOp& value) {
                               for (std::size_t list = 0; list < kListNames; ++list)
                                   for (const Value& item : value.lists[list].values())
                                       parts.push_back(ListItem{ListName(list), item, {}});
                           },
                           [&](const Map& value) {
                               for (const auto& [key, entry] : value.entries)
                                   parts.push_back(MapKey{key});
                           }});
    return parts;
}

}  // namespace

Blame::Blame(const LayerDoc& present, LayerId layer, std::string_view path, Depth depth)
    : layer_(std::move(layer)) {
    present.visit(path, [&](const LayerDoc::SpecView& spec) {
        if (depth == Depth::Spec && spec.path != path &&
            (spec.kind != SpecKind::Attribute && spec.kind != SpecKind::Relationship))
            return;
        if (depth == Depth::Spec && spec.path != path && specpath::parent(spec.path) != path)
            return;
        if (spec.kind != SpecKind::PseudoRoot) want(std::string(spec.path), {}, {});
        for (const auto& [field, value] : *spec.fields) want(std::string(spec.path), field, {});
    });
}

Blame::Blame(const LayerDoc& present, LayerId layer, const std::string& path,
             const std::string& field)
    : layer_(std::move(layer)) {
    for (FieldPart& part : partsOf(*present.field(path, field))) want(path, field, std::move(part));
    if (opinions_.empty()) want(path, field, {});
}

void Blame::want(std::string path, std::string field, FieldPart part) {
    open_[path].push_back(opinions_.size());
    BlamedOpinion one;
    one.path = std::move(path);
    one.field = std::move(field);
    one.part = std::move(part);
    opinions_.push_back(std::move(one));
}

void Blame::add(const Commit& commit) {
    recent_.clear();
    for (auto edit = commit.edits.rbegin(); edit != commit.edits.rend(); ++edit) {
        if (open_.empty() && recent_.empty()) return;
        if (edit->layer != layer_) continue;
        followRecent(*edit);
        goBefore(commit, *edit);
    }
    // A client is not sent the edits of an import. Before it, the layer had no content.
    if (commit.imported != layer_) return;
    std::vector<std::string> left;
    for (const auto& [path, indexes] : open_) left.push_back(path);
    for (const std::string& path : left)
        found(commit, path, {}, [](const BlamedOpinion&) { return true; });
}

template <class Fits>
void Blame::found(const Commit& commit, const std::string& path, std::string_view pathThen,
                  const Fits& fits) {
    const auto at = open_.find(path);
    if (at == open_.end()) return;
    std::erase_if(at->second, [&](std::size_t index) {
        BlamedOpinion& one = opinions_[index];
        if (!fits(one)) return false;
        one.revision = commit.revision;
        one.user = commit.user;
        one.timeMs = commit.timeMs;
        one.isImport = commit.imported.has_value();
        one.pathThen = pathThen;
        recent_.push_back(index);
        return true;
    });
    if (at->second.empty()) open_.erase(at);
}

void Blame::followRecent(const Edit& edit) {
    const std::string& path = edit.address.path;
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    const bool isCreated = std::holds_alternative<CreateSpec>(edit.action);
    if (!move && !isCreated) return;
    const std::string to = move ? destination(path, *move) : path;
    for (const std::size_t index : recent_) {
        std::string& then = opinions_[index].pathThen;
        if (then.empty() || !specpath::hasPrefix(then, to)) continue;
        then = move ? specpath::replacePrefix(then, to, path) : std::string();
    }
}

void Blame::goBefore(const Commit& commit, const Edit& edit) {
    const std::string& path = edit.address.path;
    const auto isSpec = [](const BlamedOpinion& one) { return one.field.empty(); };
    if (const auto* move = std::get_if<MoveSpec>(&edit.action)) {
        const std::string to = destination(path, *move);
        if (to == path) return;
        found(commit, to, path, isSpec);
        // The variants of a set begin with "/A{set=", without the brace at the end.
        const std::string_view begin =
            std::string_view(to).substr(0, to.size() - (to.ends_with("=}") ? 1 : 0));
        std::vector<decltype(open_)::node_type> moved;
        for (auto at = open_.lower_bound(begin);
             at != open_.end() && at->first.starts_with(begin);) {
            const auto next = std::next(at);
            if (specpath::hasPrefix(at->first, to)) moved.push_back(open_.extract(at));
            at = next;
        }
        for (auto& one : moved) {
            one.key() = specpath::replacePrefix(one.key(), to, path);
            open_.insert(std::move(one));
        }
    } else if (std::holds_alternative<CreateSpec>(edit.action)) {
        found(commit, path, {}, isSpec);
    } else if (const auto* set = std::get_if<SetField>(&edit.action)) {
        found(commit, path, path, [&](const BlamedOpinion& one) {
            return one.field == set->field && overlap(one.part, set->part);
        });
    } else if (const auto* erase = std::get_if<EraseField>(&edit.action)) {
        found(commit, path, path, [&](const BlamedOpinion& one) {
            return one.field == erase->field && overlap(one.part, erase->part);
        });
    }
}

}  // namespace usdlive
