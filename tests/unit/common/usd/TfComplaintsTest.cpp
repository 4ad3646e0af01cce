// Tests the collection of errors and warnings of Tf.
#include "usdlive/common/usd/TfComplaints.h"

#include <gtest/gtest.h>
#include <pxr/base/arch/demangle.h>
#include <pxr/usd/sdf/layer.h>

namespace usdlive::usd {
namespace {

using pxr::TF_DIAGNOSTIC_RUNTIME_ERROR_TYPE;  // the macro does not qualify it

TEST(TfComplaints, NamesOfOpenUsdAreThoseOfItsDocumentation) {
    const TfComplaints complaints;
    TF_WARN("%s cannot be read", pxr::ArchGetDemangled<pxr::SdfLayer>().c_str());
    EXPECT_EQ(complaints.text("nothing").find("pxrInternal"), std::string::npos);
    EXPECT_NE(complaints.text("nothing").find("SdfLayer cannot be read"), std::string::npos);
}

TEST(TfComplaints, EarlierComplaintsAreNotReturned) {
    const TfComplaints outer;
    TF_WARN("of before");
    const TfComplaints inner;
    EXPECT_EQ(inner.text("nothing"), "nothing");
    EXPECT_FALSE(inner.hasErrors());
}

TEST(TfComplaints, EndsOfLinesAreLeftOut) {
    const TfComplaints complaints;
    TF_WARN("the first\n");
    TF_WARN("the second");
    EXPECT_EQ(complaints.text("nothing"), "the first; the second");
}

TEST(TfComplaints, PassesThemOn) {
    const TfComplaints outer;
    {
        TfComplaints inner;
        TF_WARN("a warning");
        TF_RUNTIME_ERROR("an error");
        inner.pass();
    }
    EXPECT_TRUE(outer.hasErrors());
    EXPECT_EQ(outer.text("nothing"), "an error; a warning");
    {
        const TfComplaints inner;
        TF_WARN("of the inner one");
    }
    EXPECT_EQ(outer.text("nothing"), "an error; a warning");
}

}  // namespace
}  // namespace usdlive::usd
