// Tests the collection of errors and warnings of Tf.
#include "usdlive/common/usd/TfComplaints.h"

#include <gtest/gtest.h>
#include <pxr/base/arch/demangle.h>
#include <pxr/usd/sdf/layer.h>

namespace usdlive::usd {
namespace {

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

}  // namespace
}  // namespace usdlive::usd
