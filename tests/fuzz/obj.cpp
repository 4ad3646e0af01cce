// Fuzzes .obj files: reads the input, makes a layer of it, writes that and reads it again.
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/schema.h>

#include "Fuzz.h"
#include "plugins/obj/ObjLayer.h"
#include "plugins/obj/ObjText.h"

using namespace usdlive;
using fuzz::require;

namespace {

struct SpecCheck final : pxr::SdfAbstractDataSpecVisitor {
    bool VisitSpec(const pxr::SdfAbstractData&, const pxr::SdfPath& path) override {
        require(path.IsAbsoluteRootOrPrimPath() || path.IsPrimPropertyPath(), "specs have paths");
        return true;
    }
    void Done(const pxr::SdfAbstractData&) override {}
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size == 0) return 0;
    const std::string_view text = asText({data + 1, size - 1});
    obj::Options options;
    options.split = obj::Split(data[0] % 4);
    (void)obj::looksLikeObj(text);
    const auto parsed = obj::parse(text, options.split);
    if (const auto* error = std::get_if<obj::ParseError>(&parsed)) {
        require(error->line >= 1 && !error->reason.empty(), "an error says where and why");
        return 0;
    }
    const auto& model = std::get<obj::Model>(parsed);
    std::vector<std::string> warnings;
    const auto layer = obj::makeLayer(model, options, warnings);
    SpecCheck check;
    layer->VisitSpecs(&check);
    // Names may have what a file cannot store; what is stored is complete.
    const auto printed = obj::printLayer(layer, options, "comment");
    if (!printed.problem.empty()) return 0;
    const auto again = obj::parse(printed.text, options.split);
    require(std::holds_alternative<obj::Model>(again), "a written file can be read");
    const auto second = obj::makeLayer(std::get<obj::Model>(again), options, warnings);
    require(obj::printLayer(second, options, "comment").text == printed.text,
            "a file that is read and written again stays the same");
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    const std::string square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    for (const std::string& text : {
             square,
             square + "f 1 2 3 4\n",
             "mtllib a.mtl\no A b\n" + square +
                 "vt 0 0\nvt 1 1 .5\nvn 0 0 1\nusemtl x\nf 1/1/1 2/2/1 3/1/1\nusemtl y\nf 1 2 -1\n",
             square + "g a\nl 1 2 3 \\\n4\ng b\np 1 -1\ng a\nf 1//1 2//1 3//1\nvn 0 1e-3 -1\n",
             std::string("v 0 0 0 1 .5 0\nv 1 0 0 1\n# c\ns off\np 1 2\n"),
             std::string("curv 0 1\n"),
         })
        for (char split = 0; split < 4; ++split) all.push_back(copyOf(asBytes(split + text)));
    return all;
}
