// Queries the parts of a stage in C++ and writes the answers as layers, so that values of all types
// keep their type. Tests compare them with the answers of pxr.Usd.
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/types.h>

#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "usd/stage/Composition.h"
#include "usdlive/client/usd/schema/SchemaRegistry.h"
#include "usdlive/client/usd/stage/AttributeQuery.h"

using namespace usdlive;
using pxr::SdfPath;
using pxr::TfToken;

namespace {

void writeDefinition(const schema::PrimDefinition& definition, const pxr::SdfLayerHandle& layer,
                     const std::string& name) {
    const auto prim = pxr::SdfPrimSpec::New(layer, name, pxr::SdfSpecifierOver);
    for (const auto& [field, value] : definition.fields())
        layer->SetField(prim->GetPath(), field, value);
    layer->SetField(prim->GetPath(), TfToken("apiSchemas"),
                    pxr::SdfTokenListOp::CreateExplicit(definition.appliedSchemas()));
    prim->SetDocumentation(definition.documentation());
    for (const auto& property : definition.propertyNames()) {
        const auto& what = *definition.property(property);
        const SdfPath path = prim->GetPath().AppendProperty(property);
        if (what.isAttribute)
            (void)pxr::SdfAttributeSpec::New(prim, property.GetString(), what.type(),
                                             what.variability, what.custom);
        else
            (void)pxr::SdfRelationshipSpec::New(prim, property.GetString(), what.custom,
                                                what.variability);
        for (const auto& [field, value] : what.fields) layer->SetField(path, field, value);
        if (!what.fallback.IsEmpty())
            layer->SetField(path, pxr::SdfFieldKeys->Default, what.fallback);
    }
}

// Reads one type, or "-", and API schemas from each line of the input. The prim of line 3 is "_3".
// A line "=NAME" queries the schema NAME itself.
int definitions(const std::string& output) {
    const schema::SchemaRegistry registry;
    for (const auto& problem : registry.problems()) std::cout << problem << '\n';
    const auto layer = pxr::SdfLayer::CreateNew(output);
    const pxr::SdfChangeBlock block;
    std::string line;
    for (int number = 0; std::getline(std::cin, line); ++number) {
        std::istringstream words(line);
        std::string type, word;
        words >> type;
        pxr::TfTokenVector schemas;
        while (words >> word) schemas.emplace_back(word);
        const std::string name = "_" + std::to_string(number);
        if (type.starts_with('=')) {
            const auto* definition = registry.schemaDefinition(TfToken(type.substr(1)));
            if (definition) writeDefinition(*definition, layer, name);
        } else {
            writeDefinition(registry.definition(TfToken(type == "-" ? "" : type), schemas), layer,
                            name);
        }
    }
    return layer->Save() ? 0 : 1;
}

// Reads an API schema and a type from each line of the input. Prints yes or no.
int applying() {
    const schema::SchemaRegistry registry;
    std::string name, type;
    while (std::cin >> name >> type) {
        std::string whyNot;
        const bool can = registry.canApply(TfToken(name), TfToken(type), &whyNot);
        std::cout << (can ? "yes" : "no " + whyNot) << '\n';
    }
    return 0;
}

const char* nameOf(stage::ValueSource source) {
    static constexpr const char* kNames[] = {"none",        "fallback",   "default",
                                             "timeSamples", "valueClips", "spline"};
    return kNames[int(source)];
}

// A text contains only the authored part of an asset path.
template <class Strings>
void addParts(const pxr::SdfAssetPath& path, Strings& parts) {
    for (const auto& part :
         {path.GetAuthoredPath(), path.GetEvaluatedPath(), path.GetResolvedPath()})
        parts.push_back(part);
}
pxr::VtValue inFull(const pxr::VtValue& value) {
    pxr::VtStringArray parts;
    if (value.IsHolding<pxr::SdfAssetPath>())
        addParts(value.UncheckedGet<pxr::SdfAssetPath>(), parts);
    else if (value.IsHolding<pxr::VtArray<pxr::SdfAssetPath>>())
        for (const auto& path : value.UncheckedGet<pxr::VtArray<pxr::SdfAssetPath>>())
            addParts(path, parts);
    else
        return value;
    return pxr::VtValue(parts);
}

void writeValues(const stage::AttributeQuery& query, const pxr::SdfLayerHandle& layer,
                 const std::string& name, const std::vector<double>& times) {
    const auto prim = pxr::SdfPrimSpec::New(layer, name, pxr::SdfSpecifierOver);
    const SdfPath path = prim->GetPath().AppendProperty(TfToken("value"));
    const auto ofDefault = inFull(query.getDefault());
    std::map<double, pxr::VtValue> samples;
    for (const double time : times)
        if (auto value = inFull(query.get(time)); !value.IsEmpty()) samples[time] = value;
    const auto& any = ofDefault.IsEmpty() && !samples.empty() ? samples.begin()->second : ofDefault;
    if (any.IsEmpty()) return;
    const auto type = pxr::SdfSchema::GetInstance().FindType(any);
    (void)pxr::SdfAttributeSpec::New(prim, "value", type);
    if (!ofDefault.IsEmpty()) layer->SetField(path, pxr::SdfFieldKeys->Default, ofDefault);
    for (const auto& [time, value] : samples) layer->SetTimeSample(path, time, value);
}

// Reads a prim, an attribute, a type or "-", and API schemas from each line of the input. The
// values of line 3 are those of /_3.value. Prints the source, whether the value is blocked, whether
// it might vary, and the times of its samples.
int values(const std::string& root, const std::string& output, const std::vector<double>& times) {
    const schema::SchemaRegistry registry;
    const auto rootLayer = pxr::SdfLayer::FindOrOpen(root);
    stage::Composition composition(rootLayer, nullptr, {}, stage::Composition::Payloads::All);
    const auto layer = pxr::SdfLayer::CreateNew(output);
    std::string line;
    for (int number = 0; std::getline(std::cin, line); ++number) {
        std::istringstream words(line);
        std::string prim, attribute, type, word;
        words >> prim >> attribute >> type;
        pxr::TfTokenVector schemas;
        while (words >> word) schemas.emplace_back(word);
        const auto& definition = registry.definition(TfToken(type == "-" ? "" : type), schemas);
        const TfToken name(attribute);
        const stage::AttributeQuery query(*composition.primIndex(SdfPath(prim)), name,
                                          definition.property(name));
        writeValues(query, layer, "_" + std::to_string(number), times);
        std::cout << nameOf(query.source()) << ' ' << query.isBlocked() << ' '
                  << query.mightBeTimeVarying();
        std::cout.precision(17);
        for (const double time : query.timeSamples()) std::cout << ' ' << time;
        std::cout << '\n';
    }
    return layer->Save() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    if (arguments.size() == 2 && arguments[0] == "definitions") return definitions(arguments[1]);
    if (arguments.size() == 1 && arguments[0] == "applying") return applying();
    if (arguments.size() > 2 && arguments[0] == "values") {
        std::vector<double> times;
        for (std::size_t at = 3; at < arguments.size(); ++at)
            times.push_back(std::stod(arguments[at]));
        return values(arguments[1], arguments[2], times);
    }
    std::cerr << "usage: stage_probe definitions OUTPUT | applying | values ROOT OUTPUT TIME...\n";
    return 2;
}
