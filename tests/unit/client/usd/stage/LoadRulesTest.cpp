// Tests that load rules list the rule of each path, and drop rules that a new one replaces.
#include "usdlive/client/usd/stage/LoadRules.h"

#include <gtest/gtest.h>

namespace usdlive::stage {
namespace {

using pxr::SdfPath;
using Rule = LoadRules::Rule;
using Rules = std::map<SdfPath, Rule>;

TEST(LoadRules, ListsTheRuleOfEachPath) {
    EXPECT_TRUE(LoadRules::all().rules().empty());
    LoadRules rules = LoadRules::none();
    rules.set(SdfPath("/A/B"), Rule::Only);
    rules.set(SdfPath("/C"), Rule::All);
    EXPECT_EQ(rules.rules(), (Rules{{SdfPath("/"), Rule::None},
                                    {SdfPath("/A/B"), Rule::Only},
                                    {SdfPath("/C"), Rule::All}}));
    rules.set(SdfPath("/A"), Rule::All);
    EXPECT_EQ(
        rules.rules(),
        (Rules{{SdfPath("/"), Rule::None}, {SdfPath("/A"), Rule::All}, {SdfPath("/C"), Rule::All}}))
        << "a rule replaces those below it";
}

}  // namespace
}  // namespace usdlive::stage
