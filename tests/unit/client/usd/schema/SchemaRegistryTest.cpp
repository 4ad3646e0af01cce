// Tests the names of schemas and the definitions that SchemaRegistry returns.
#include "usdlive/client/usd/schema/SchemaRegistry.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace usdlive::schema {
namespace {

using pxr::TfToken;

const SchemaRegistry& schemaRegistry() {
    static const SchemaRegistry registry;  // shared, because reading all schemas takes a moment
    return registry;
}

TEST(SchemaNames, AnIdentifierIsAFamilyAndAVersion) {
    EXPECT_EQ(familyAndVersion(TfToken("Capsule")), (std::pair{TfToken("Capsule"), 0U}));
    EXPECT_EQ(familyAndVersion(TfToken("Capsule_1")), (std::pair{TfToken("Capsule"), 1U}));
    EXPECT_EQ(familyAndVersion(TfToken("A_1_12")), (std::pair{TfToken("A_1"), 12U}));
    EXPECT_EQ(familyAndVersion(TfToken("Capsule_")), (std::pair{TfToken("Capsule_"), 0U}));
    EXPECT_EQ(familyAndVersion(TfToken("Capsule1")), (std::pair{TfToken("Capsule1"), 0U}));
    const TfToken tooBig("Capsule_99999999999999999999");
    EXPECT_EQ(familyAndVersion(tooBig), (std::pair{tooBig, 0U}));
}

TEST(SchemaNames, APlaceholderIsAWholePartOfAName) {
    const TfToken a("a:b");
    EXPECT_EQ(withInstanceName(TfToken("x:__INSTANCE_NAME__:y"), a), TfToken("x:a:b:y"));
    EXPECT_EQ(withInstanceName(TfToken("__INSTANCE_NAME__"), a), a);
    EXPECT_EQ(withInstanceName(TfToken("x__INSTANCE_NAME__:__INSTANCE_NAME__"), a),
              TfToken("x__INSTANCE_NAME__:a:b"));
    EXPECT_FALSE(isNameTemplate(TfToken("x:my__INSTANCE_NAME__")));
    EXPECT_EQ(templateBaseName(TfToken("x:__INSTANCE_NAME__:y:z")), "y:z");
    EXPECT_EQ(templateBaseName(TfToken("x:__INSTANCE_NAME__")), "");
}

TEST(SchemaRegistry, PropertiesOfSchemasAreBuiltIn) {
    const auto& registry = schemaRegistry();
    const TfToken mesh("Mesh");
    EXPECT_TRUE(registry.isBuiltIn(mesh, {}, TfToken("points")));
    EXPECT_TRUE(registry.isBuiltIn(mesh, {TfToken("CollectionAPI:lights")},
                                   TfToken("collection:lights:includes")));
    EXPECT_FALSE(registry.isBuiltIn(mesh, {}, TfToken("collection:lights:includes")));
    EXPECT_FALSE(registry.isBuiltIn(mesh, {TfToken("UnknownAPI")}, TfToken("material:binding")));
    EXPECT_TRUE(registry.isA(mesh, TfToken("Imageable")));
    EXPECT_FALSE(registry.isA(mesh, TfToken("Xform")));
}

TEST(SchemaRegistry, AnUnknownTypeIsTheFirstKnownOneOfItsFallbacks) {
    pxr::VtDictionary fallbacks;
    fallbacks["Future"] =
        pxr::VtTokenArray{TfToken("FutureToo"), TfToken("Imageable"), TfToken("Sphere")};
    const auto& registry = schemaRegistry();
    EXPECT_EQ(registry.effectiveType(TfToken("Future"), fallbacks), TfToken("Sphere"));
    EXPECT_EQ(registry.effectiveType(TfToken("Mesh"), fallbacks), TfToken("Mesh"));
    EXPECT_EQ(registry.effectiveType(TfToken("Unknown"), fallbacks), TfToken());
}

TEST(SchemaRegistry, ThreadsShareOneDefinition) {
    std::vector<const PrimDefinition*> found(8);
    {
        std::vector<std::jthread> threads;
        for (auto& one : found)
            threads.emplace_back([&one] {
                one = &schemaRegistry().definition(TfToken("Cube"), {TfToken("ShadowAPI")});
            });
    }
    for (const auto* one : found) EXPECT_EQ(one, found.front());
    EXPECT_EQ(found.front()->appliedSchemas(), pxr::TfTokenVector{TfToken("ShadowAPI")});
}

}  // namespace
}  // namespace usdlive::schema
