// Runs a script of "VERB CLASS PATH" lines with the generated classes of every kind of schema, on
// one layer, and prints what each line gives. Tests run the same script with the Python classes and
// with pxr.Usd, and compare the output and the layers.
#include "Kinds.h"

#include <pxr/usd/sdf/layer.h>

#include <iostream>

#include "usdlive/client/usd/stage/Stage.h"

using namespace usdlive;
using pxr::SdfPath;

namespace {

template <class T>
std::string said(const Result<T>& result) {
    return result ? "done" : "refused";
}

template <class Schema>
Schema on(const stage::Prim& prim) {
    if constexpr (std::is_constructible_v<Schema, stage::Prim, std::string>)
        return Schema(prim, "a");
    else
        return Schema(prim);
}

template <class Schema>
std::string add(stage::Stage& stage, const SdfPath& path) {
    const auto prim = stage.prim(path);
    if constexpr (requires { Schema::define(stage, path); })
        return said(Schema::define(stage, path));
    else if constexpr (requires { Schema::apply(prim, "a"); })
        return said(Schema::apply(prim, "a"));
    else if constexpr (requires { Schema::apply(prim); })
        return said(Schema::apply(prim));
    else
        return "impossible";
}

template <class Schema>
std::string run(const std::string& verb, stage::Stage& stage, const SdfPath& path) {
    const auto schema = on<Schema>(stage.prim(path));
    if (verb == "valid") return schema ? "true" : "false";
    if (verb == "add") return add<Schema>(stage, path);
    if (verb == "remove") {
        if constexpr (requires { schema.remove(); }) return said(schema.remove());
    } else if (verb == "set") {
        if constexpr (requires { schema.setNumber(7); }) return said(schema.setNumber(7));
    } else if (verb == "get") {
        if constexpr (requires { schema.number(); })
            return schema.number() ? std::to_string(int(*schema.number())) : "None";
    } else if (verb == "text") {
        if constexpr (requires { schema.setPlug("on"); }) return said(schema.setPlug("on"));
        if constexpr (requires { schema.setText("new"); }) return said(schema.setText("new"));
        if constexpr (requires { schema.setMode(pxr::TfToken("slow")); })
            return said(schema.setMode(pxr::TfToken("slow")));
    } else if (verb == "opaque") {
        const pxr::SdfOpaqueValue value;
        if constexpr (requires { schema.setGroupValue(value); })
            return said(schema.setGroupValue(value));
    } else if (verb == "link") {
        if constexpr (requires { schema.setLinks({path}); }) return said(schema.setLinks({path}));
    }
    return "impossible";
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const auto layer = pxr::SdfLayer::FindOrOpen(argv[1]);
    stage::Stage stage(layer);
    stage.setEditTarget(stage.editTargetFor(layer));
    using namespace schemas;
    const std::map<std::string, decltype(&run<KindsLamp>)> classes = {
        {"KindsFreeAPI", run<KindsFreeAPI>},
        {"KindsFreerAPI", run<KindsFreerAPI>},
        {"KindsCardAPI", run<KindsCardAPI>},
        {"KindsLamp", run<KindsLamp>},
        {"KindsThing", run<KindsThing>},
        {"KindsRoom", run<KindsRoom>},
        {"KindsDimAPI", run<KindsDimAPI>},
        {"KindsPlainAPI", run<KindsPlainAPI>},
        {"PlugAPI", run<PlugAPI>},
        {"KindsMarkAPI", run<KindsMarkAPI>},
        {"KindsTypesAPI", run<KindsTypesAPI>},
    };
    std::string verb, name, path;
    while (std::cin >> verb >> name >> path)
        std::cout << classes.at(name)(verb, stage, SdfPath(path)) << '\n';
    return layer->Save() ? 0 : 1;
}
