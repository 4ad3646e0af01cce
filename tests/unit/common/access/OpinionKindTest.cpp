// Tests to which kind of opinion an edit belongs (AC7).
#include "usdlive/common/access/OpinionKind.h"

#include <gtest/gtest.h>

namespace usdlive {
namespace {

std::string kindOf(const std::string& path, const EditAction& action, bool exists = true) {
    const auto kind = opinionKindOf(path, action, exists);
    return kind ? std::string(nameOf(*kind)) : "nothing";
}

TEST(OpinionKind, AC7OfFields) {
    for (const auto& [path, field, kind] :
         std::vector<std::tuple<const char*, const char*, const char*>>{
             {"/A.xformOp:translate", "default", "transform"},
             {"/A.xformOpOrder", "default", "transform"},
             {"/A.xformOp:translate", "timeSamples", "animation"},
             {"/A.size", "spline", "animation"},
             {"/A.points", "default", "geometry"},
             {"/A.primvars:st", "default", "geometry"},
             {"/A.primvars:st", "interpolation", "geometry"},
             {"/A.primvars:displayColor", "default", "shading"},
             {"/A.inputs:intensity", "default", "shading"},
             {"/A.outputs:surface", "connectionPaths", "shading"},
             {"/A.material:binding", "targetPaths", "shading"},
             {"/A.visibility", "default", "property"},
             {"/A.physics:mass", "default", "property"},
             {"/A.x", "documentation", "metadata"},
             {"/A", "variantSelection", "variants"},
             {"/A", "variantSetNames", "variants"},
             {"/A", "references", "composition"},
             {"/A", "payload", "composition"},
             {"/", "subLayers", "composition"},
             {"/", "expressionVariables", "composition"},
             {"/A", "typeName", "schema"},
             {"/A", "apiSchemas", "schema"},
             {"/A", "clips", "animation"},
             {"/A", "active", "metadata"},
             {"/", "customLayerData", "metadata"},
             {"/A", "primOrder", "namespace"}}) {
        EXPECT_EQ(kindOf(path, SetField{field, {}, {}, {}}), kind) << path << " " << field;
        EXPECT_EQ(kindOf(path, EraseField{field, {}}), kind) << path << " " << field;
    }
    EXPECT_EQ(kindOf("/A.x", SetField{"typeName", {}, {}, {}}), "nothing");
}

TEST(OpinionKind, AC7OfSpecs) {
    EXPECT_EQ(kindOf("/A", CreateSpec{SpecKind::Prim}, false), "nothing");
    EXPECT_EQ(kindOf("/A.x", CreateSpec{SpecKind::Attribute}, false), "nothing");
    EXPECT_EQ(kindOf("/A{v=}", CreateSpec{SpecKind::VariantSet}, false), "variants");
    EXPECT_EQ(kindOf("/A{v=one}", CreateSpec{SpecKind::Variant}, false), "variants");
    EXPECT_EQ(kindOf("/A", DeleteSpec{}), "namespace");
    EXPECT_EQ(kindOf("/A{v=one}B", DeleteSpec{}), "namespace");
    EXPECT_EQ(kindOf("/A{v=one}", DeleteSpec{}), "variants");
    EXPECT_EQ(kindOf("/A.xformOp:translate", DeleteSpec{}), "transform");
    EXPECT_EQ(kindOf("/A", MoveSpec{{"/", {}}, "B"}), "namespace");
    EXPECT_EQ(kindOf("/A.x", MoveSpec{{"/A", {}}, "y"}), "namespace");
    EXPECT_EQ(kindOf("/A", PlaceSpec{}), "namespace");
    EXPECT_EQ(kindOf("/A.inputs:x", PlaceSpec{}), "shading");
}

TEST(OpinionKind, AC7ANewOverStatesNothing) {
    const auto sets = [](std::uint8_t specifier) {
        return SetField{"specifier", {}, Value(ValueType::Specifier, Bytes{specifier}), {}};
    };
    constexpr std::uint8_t kDef = 0, kOver = 1;
    EXPECT_EQ(kindOf("/A", sets(kOver), false), "nothing");
    EXPECT_EQ(kindOf("/A", sets(kOver), true), "namespace");
    EXPECT_EQ(kindOf("/A", sets(kDef), false), "namespace");
}

}  // namespace
}  // namespace usdlive
