// A random history of one layer, by three users.
#pragma once

#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "unit/common/layer/RandomEdits.h"

namespace usdlive {

inline const LayerId kLayer{"shot.usda"};

/// Commits of executed edits, and the content before and after each. Node ids are those of one doc,
/// so that a test can follow specs without their paths.
struct RandomHistory {
    std::vector<LayerDoc> docs;   ///< docs[n] is the content at revision n
    std::vector<Commit> commits;  ///< commits[n] makes docs[n + 1] of docs[n]

    RandomHistory(unsigned seed, int count) {
        static const std::vector<std::string> kUsers{"ann", "bob", "cy"};
        RandomEdits random(seed);
        LayerDoc doc;
        for (int step = 0; step < 20; ++step) {
            const auto [path, action] = random.edit(doc);
            (void)doc.apply(path, action);
        }
        docs.push_back(doc);
        while (int(commits.size()) < count) {
            Commit commit;
            commit.revision = docs.size();
            commit.user = UserName{random.of(kUsers)};
            commit.id.client = ClientId{commit.user.value};
            for (std::size_t edits = 1 + random.below(3); commit.edits.size() < edits;) {
                auto [path, action] = random.edit(doc);
                if (random.chance(2))
                    std::tie(path, action) =
                        std::pair(random.of(RandomEdits::paths(doc)), random.fieldEdit());
                const auto applied = doc.apply(path, action);
                if (applied && applied->changed)
                    commit.edits.push_back({kLayer, {path, {}}, action, {}});
            }
            commits.push_back(std::move(commit));
            docs.push_back(doc);
        }
    }
};

/// Returns the path of a node; empty if the doc does not have it.
inline std::string pathOfNode(const LayerDoc& doc, NodeId node) {
    std::string path;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        if (spec.node == node) path = spec.path;
    });
    return path;
}

}  // namespace usdlive
