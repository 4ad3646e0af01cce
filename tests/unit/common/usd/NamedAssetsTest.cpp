// Tests which layers and files a field names.
#include "usdlive/common/usd/NamedAssets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>

namespace usdlive::usd {
namespace {

using pxr::SdfAssetPath;
using pxr::VtDictionary;
using pxr::VtValue;
using testing::UnorderedElementsAre;

std::set<std::string> named(const VtValue& value) {
    std::set<std::string> assets;
    addNamedAssets(value, assets);
    return assets;
}

TEST(NamedAssets, ArcsNameAllButDeletedItems) {
    pxr::SdfReferenceListOp references;
    references.SetPrependedItems({pxr::SdfReference("a.usda"), pxr::SdfReference("", {})});
    references.SetAppendedItems({pxr::SdfReference("b.usda")});
    references.SetDeletedItems({pxr::SdfReference("c.usda")});
    EXPECT_THAT(named(VtValue(references)), UnorderedElementsAre("a.usda", "b.usda"));
    const auto payloads = pxr::SdfPayloadListOp::CreateExplicit({pxr::SdfPayload("p.usd")});
    EXPECT_THAT(named(VtValue(payloads)), UnorderedElementsAre("p.usd"));
    EXPECT_THAT(named(VtValue(pxr::SdfPayload("old.usd"))), UnorderedElementsAre("old.usd"));
    EXPECT_THAT(named(VtValue(std::vector<std::string>{"sub.usda", ""})),
                UnorderedElementsAre("sub.usda"));
}

TEST(NamedAssets, ClipsNameTheirFilesManifestsAndTemplates) {
    VtDictionary explicitSet, derivedSet, clips;
    explicitSet["assetPaths"] =
        pxr::VtArray<SdfAssetPath>{SdfAssetPath("1.usda"), SdfAssetPath("2.usda"), SdfAssetPath()};
    explicitSet["primPath"] = std::string("/Model");
    derivedSet["manifestAssetPath"] = SdfAssetPath("manifest.usda");
    derivedSet["templateAssetPath"] = std::string("clip.##.usda");
    clips["one"] = explicitSet;
    clips["two"] = derivedSet;
    EXPECT_THAT(named(VtValue(clips)),
                UnorderedElementsAre("1.usda", "2.usda", "manifest.usda", "clip.##.usda"));
    // A part of the metadata, as it is written with a key.
    EXPECT_THAT(named(clips["two"]), UnorderedElementsAre("manifest.usda", "clip.##.usda"));
    EXPECT_THAT(named(VtValue(7)), UnorderedElementsAre());
}

TEST(NamedAssets, TemplatesStandForNumbers) {
    EXPECT_TRUE(isTemplate("clip.#.usda"));
    EXPECT_FALSE(isTemplate("clip.1.usda"));
    for (const char* path : {"clip.7.usda", "clip.007.usda", "clip.12345.usda", "clip.-03.usda"})
        EXPECT_TRUE(matchesTemplate("clip.###.usda", path)) << path;
    for (const char* path : {"clip..usda", "clip.main.usda", "clip.7.usd", "clip.7",
                             "clip.7.usda.x", "other.7.usda", "", "clip.-.usda"})
        EXPECT_FALSE(matchesTemplate("clip.###.usda", path)) << path;
    EXPECT_TRUE(matchesTemplate("a/clip.##.##.usda", "a/clip.01.25.usda"));
    EXPECT_FALSE(matchesTemplate("a/clip.##.##.usda", "a/clip.01.usda"));
    EXPECT_TRUE(matchesTemplate("clip.#", "clip.9"));
}

}  // namespace
}  // namespace usdlive::usd
