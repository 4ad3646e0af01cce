// Commits for tests of stores.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <random>

#include "project/CommitContent.h"
#include "project/CommitStore.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server::test {

/// The file stamp of imported layers.
inline const FileStamp kFile{{1, 2, 3, 4}, {}};

/// Makes the commits of a project, one after the other, like Project, and keeps the layers that a
/// store must return.
class TestCommits {
public:
    CommitRecord next(std::vector<Edit> edits) {
        std::vector<ExecutedEdit> executed;
        for (Edit& edit : edits) {
            auto applied = layers[edit.layer].apply(edit.address.path, edit.action);
            if (applied && applied->changed)
                executed.push_back({std::move(edit), std::move(*applied)});
        }
        Commit commit = begin();
        for (const ExecutedEdit& one : executed) commit.edits.push_back(one.edit);
        CommitRecord record = finish(commit);
        for (const ExecutedEdit& one : executed) record.layers.insert(one.edit.layer);
        record.namespaceChanges = namespaceChanges(head.revision, executed);
        return record;
    }
    CommitRecord next(const LayerId& layer, const std::string& path, EditAction action) {
        return next({Edit{layer, {path, {}}, std::move(action)}});
    }
    /// Makes the commit that imports a layer.
    CommitRecord import(const LayerId& layer, const LayerDoc& doc) {
        Commit commit = begin();
        commit.imported = layer;
        for (auto& [path, action] : difference(LayerDoc(), doc))
            commit.edits.push_back({layer, {path, {}}, std::move(action)});
        CommitRecord record = finish(commit);
        record.layers = {layer};
        record.saved = CommitRecord::Saved{layer, {head.revision, kFile}};
        layers[layer] = doc;
        return record;
    }
    /// Makes a commit without edits.
    CommitRecord empty() { return finish(begin()); }

    LayerDocs layers;
    CommitStore::Head head;
    TransactionId id{{"00112233445566778899aabbccddeeff"}, 0};
    bool inParts = false;  ///< commits with several edits (FR8)

private:
    Commit begin() {
        ++id.sequence;
        Commit commit;
        commit.revision = head.revision + 1;
        commit.epoch = 1;
        commit.id = id;
        commit.user = {"ada"};
        commit.previous = head.hash;
        return commit;
    }
    [[nodiscard]] Bytes encoded(const Commit& commit) const {
        if (!inParts || commit.imported) return encodeFrame(CommitFrame{commit});
        Bytes frames;
        for (PartsAt at; !at.isEnd;) appendBytes(frames, encodePart(commit, at, 200));
        return frames;
    }
    CommitRecord finish(const Commit& commit) {
        CommitRecord record;
        record.revision = ++head.revision;
        record.id = id;
        record.frame = std::make_shared<const Bytes>(encoded(commit));
        record.hash = head.hash = chainHash(head.hash, ByteView(*record.frame).subspan(4));
        return record;
    }
};

/// Makes edits of all kinds, most of which are valid.
class RandomEdits {
public:
    explicit RandomEdits(unsigned seed) : random_(seed) {}

    std::size_t below(std::size_t bound) { return random_() % bound; }

    std::vector<Edit> next(const LayerId& layer, const LayerDoc& doc) {
        std::vector<std::string> prims{"/"}, attributes;
        doc.visit([&](const LayerDoc::SpecView& spec) {
            if (spec.kind == SpecKind::Prim) prims.emplace_back(spec.path);
            if (spec.kind == SpecKind::Attribute) attributes.emplace_back(spec.path);
        });
        const auto& prim = prims[below(prims.size())];
        const auto edit = [&](std::string path, EditAction action) {
            return Edit{layer, {std::move(path), {}}, std::move(action)};
        };
        if (attributes.empty() || below(4) == 0) return structure(prim, prims, edit);
        std::vector<Edit> edits;
        for (auto left = below(4) + 1; left > 0; --left)
            edits.push_back(edit(attributes[below(attributes.size())], content()));
        return edits;
    }

private:
    template <class MakeEdit>
    std::vector<Edit> structure(const std::string& prim, const std::vector<std::string>& prims,
                                MakeEdit edit) {
        const std::string name(1, char('A' + below(6)));
        switch (below(8)) {
            case 0:
                return {edit(prim, DeleteSpec{})};
            case 1:
                return {edit(prim, MoveSpec{{prims[below(prims.size())], {}}, name})};
            case 2:
                return {edit(prim, PlaceSpec{name})};
            case 3:
            case 4:
                return {edit(specpath::child(prim, ChildList::Properties, name),
                             CreateSpec{SpecKind::Attribute})};
            default:
                return {edit(specpath::child(prim, ChildList::Prims, name),
                             CreateSpec{SpecKind::Prim})};
        }
    }
    EditAction content() {
        const std::string field = below(2) ? "default" : "timeSamples";
        const double time = double(below(7)) - 3.5;
        switch (below(10)) {
            case 0:
                return usdlive::EraseField{field, {}};
            case 1:
            case 2:
                return usdlive::EraseField{field, SampleTime{time}};
            case 3:
                return SetField{field, {}, doubleValue(double(random_()))};
            case 4:
                return SetField{field, {}, samples()};
            case 5:
                return SetField{"customData", DictionaryKey{{"a", std::to_string(below(3))}},
                                doubleValue(double(random_()))};
            default:
                return SetField{field, SampleTime{time}, doubleValue(double(random_()))};
        }
    }
    TimeSamples samples() {
        TimeSamples all;
        for (std::size_t at = 0, end = below(5); at < end; ++at)
            all.samples.emplace(double(at) - 2.5, doubleValue(double(random_())));
        return all;
    }

    std::mt19937 random_;
};

/// A folder that is deleted with all its content.
class TestFolder {
public:
    TestFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "usdlive-XXXXXX").string();
        if (::mkdtemp(name.data())) path = name;
    }
    TestFolder(const TestFolder&) = delete;
    TestFolder& operator=(const TestFolder&) = delete;
    ~TestFolder() { std::filesystem::remove_all(path); }

    std::filesystem::path path;
};

}  // namespace usdlive::server::test
