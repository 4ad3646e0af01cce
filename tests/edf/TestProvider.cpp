// A provider that behaves well or badly, as its argument `behaviour` says, and writes its calls to
// the file EDF_TEST_LOG.
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/getenv.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

#include "usdlive/edf/DataProvider.h"

namespace {

using pxr::SdfPath;
using pxr::TF_DIAGNOSTIC_RUNTIME_ERROR_TYPE;  // the macro needs it
using pxr::TfToken;
using pxr::VtValue;
using usdlive::edf::EdfArguments;
using usdlive::edf::EdfDataParameters;
using usdlive::edf::IEdfSourceData;

const SdfPath kData("/Data");

std::string behaviourOf(const EdfArguments& arguments) {
    const auto found = arguments.find("behaviour");
    return found == arguments.end() ? "" : found->second;
}

void note(const std::string& what) {
    const auto file = pxr::TfGetenv("EDF_TEST_LOG");
    if (!file.empty()) std::ofstream(file, std::ios::app) << what + "\n";
}

void waitForever(const IEdfSourceData& data) {
    while (!data.IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

// Content with a value of each kind, for copies.
void createAll(IEdfSourceData& data) {
    const SdfPath prim = kData.AppendChild(TfToken("All"));
    data.CreatePrim(kData, "All", pxr::SdfSpecifierDef, TfToken("Scope"));
    data.SetField(prim, pxr::SdfFieldKeys->Kind, VtValue(TfToken("component")));
    data.CreateAttribute(prim, TfToken("still"), pxr::SdfValueTypeNames->Double,
                         pxr::SdfVariabilityUniform, VtValue(1.5));
    data.CreateAttribute(prim, TfToken("moving"), pxr::SdfValueTypeNames->Double,
                         pxr::SdfVariabilityVarying, {});
    const SdfPath moving = prim.AppendProperty(TfToken("moving"));
    data.SetField(moving, pxr::SdfFieldKeys->TimeSamples,
                  VtValue(pxr::SdfTimeSampleMap{{1, VtValue(2.0)}, {5, VtValue(4.0)}}));
    data.CreateRelationship(prim, TfToken("others"), {prim.AppendChild(TfToken("Class"))});
    data.CreatePrim(prim, "Class", pxr::SdfSpecifierClass, {});
    if (!data.HasAttribute(moving) || !data.HasField(moving, pxr::SdfFieldKeys->TimeSamples) ||
        data.HasField(moving, pxr::SdfFieldKeys->Default))
        throw std::logic_error("the content is not what was written");
}

class TestProvider final : public usdlive::edf::IEdfDataProvider {
public:
    explicit TestProvider(const EdfDataParameters& parameters) : parameters_(parameters) {
        if (behaviour_ == "throws when created") throw std::runtime_error("no provider today");
    }

    static EdfArguments ComposeArguments(EdfArguments metadata) {
        if (behaviourOf(metadata) == "refuses")
            throw std::invalid_argument("these arguments are wrong");
        return metadata;
    }

    bool Read(IEdfSourceData& data, std::string& why) override {
        note("read " + behaviour_ + name());
        if (behaviour_ == "lazy") return data.DeferChildren(kData);
        if (behaviour_ == "fails") return why = "the well is dry", false;
        if (behaviour_ == "fails without a reason") return false;
        if (behaviour_ == "throws") throw std::runtime_error("the well is deep");
        if (behaviour_ == "throws a number") throw 7;
        if (behaviour_ == "posts an error") TF_RUNTIME_ERROR("posted by the provider");
        if (behaviour_ == "hangs") waitForever(data);
        if (behaviour_ == "never returns") std::this_thread::sleep_for(std::chrono::hours(24));
        if (behaviour_ == "warns") data.Warn("one part is missing");
        if (behaviour_ == "all kinds") createAll(data);
        if (behaviour_ == "bad name") data.CreatePrim(kData, "1 2", pxr::SdfSpecifierDef, {});
        if (behaviour_ == "bad type")
            data.CreatePrim(kData, "A", pxr::SdfSpecifierDef, TfToken("a b"));
        if (behaviour_ == "outside")
            data.CreatePrim(SdfPath("/Other"), "A", pxr::SdfSpecifierDef, {});
        if (behaviour_ == "twice" || behaviour_ == "well")
            data.CreatePrim(kData, "A", pxr::SdfSpecifierDef, {});
        if (behaviour_ == "twice") data.CreatePrim(kData, "A", pxr::SdfSpecifierDef, {});
        if (behaviour_ == "bad value")
            data.CreateAttribute(kData, TfToken("a"), pxr::SdfValueTypeNames->Int,
                                 pxr::SdfVariabilityVarying, VtValue("text"));
        if (behaviour_ == "unknown field") data.SetField(kData, TfToken("nonsense"), VtValue(1));
        if (behaviour_ == "schemas as tokens")
            data.SetField(kData, TfToken("apiSchemas"),
                          VtValue(std::vector<TfToken>{TfToken("ArtistAPI")}));
        if (behaviour_ == "own children")
            data.SetField(kData, TfToken("primChildren"),
                          VtValue(std::vector<TfToken>{TfToken("Ghost")}));
        if (behaviour_.starts_with("deferred")) return defer(data);
        return true;
    }

    bool ReadChildren(const SdfPath& prim, IEdfSourceData& data, std::string& why) override {
        note("children " + prim.GetAsString());
        if (behaviour_ == "deferred, fails") return why = "the shelf is empty", false;
        if (behaviour_ == "deferred, throws") throw std::runtime_error("the shelf fell");
        if (behaviour_ == "deferred, hangs") waitForever(data);
        if (behaviour_ == "deferred, own property")
            data.CreateAttribute(prim, TfToken("late"), pxr::SdfValueTypeNames->Int,
                                 pxr::SdfVariabilityVarying, {});
        if (prim.GetPathElementCount() > 3) return true;
        for (const char* name : {"X", "Y"}) {
            const SdfPath path = prim.AppendChild(TfToken(name));
            data.CreatePrim(prim, name, pxr::SdfSpecifierDef, TfToken("Scope"));
            data.CreateAttribute(path, TfToken("depth"), pxr::SdfValueTypeNames->Int,
                                 pxr::SdfVariabilityVarying,
                                 VtValue(int(path.GetPathElementCount())));
            if (path.GetPathElementCount() < 4) data.DeferChildren(path);
        }
        return true;
    }

private:
    bool defer(IEdfSourceData& data) {
        for (const char* name : {"One", "Two"}) {
            data.CreatePrim(kData, name, pxr::SdfSpecifierDef, TfToken("Scope"));
            data.DeferChildren(kData.AppendChild(TfToken(name)));
        }
        return true;
    }

    [[nodiscard]] std::string name() const {
        const auto found = parameters_.providerArgs.find("name");
        return found == parameters_.providerArgs.end() ? "" : " " + found->second;
    }

    const EdfDataParameters parameters_;
    const std::string behaviour_ = behaviourOf(parameters_.providerArgs);
};

// A factory of another interface, such as one of another version.
class ForeignFactory : public pxr::TfType::FactoryBase {};

}  // namespace

EDF_DEFINE_DATAPROVIDER(TestProvider, "EdfTestProvider");

namespace edf_test_foreign {
using namespace pxr;
TF_REGISTRY_FUNCTION(TfType) {
    TfType::Declare("EdfForeignProvider", {TfType::Declare("IEdfDataProvider")})
        .SetFactory(std::make_unique<ForeignFactory>());
}
}  // namespace edf_test_foreign
