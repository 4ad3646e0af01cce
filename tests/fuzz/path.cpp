// Fuzzes paths of specs, compared with OpenUSD's own, and names of layers, including the files that
// they name.
#include <pxr/usd/sdf/path.h>

#include <filesystem>

#include "Fuzz.h"
#include "files/LayerFiles.h"
#include "storage/BlobStore.h"
#include "usdlive/common/core/FilePath.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/usd/TfComplaints.h"

using namespace usdlive;
namespace fs = std::filesystem;
using fuzz::require;

namespace {

bool isSpec(const pxr::SdfPath& path) {
    return path.IsAbsolutePath() && (path.IsAbsoluteRootOrPrimPath() || path.IsPrimPropertyPath() ||
                                     path.IsPrimVariantSelectionPath());
}

// True for paths that USD allows and usdlive does not: nothing is below a variant without a name
// (PA1), and a variant set has an identifier as its name (PA2), as in Sdf's API but not in its
// parser.
bool isBeyondOurs(const pxr::SdfPath& path) {
    for (const pxr::SdfPath& prefix : path.GetPrefixes()) {
        if (!prefix.IsPrimVariantSelectionPath()) continue;
        const auto [set, variant] = prefix.GetVariantSelection();
        if (!pxr::SdfPath::IsValidIdentifier(set) || (variant.empty() && prefix != path))
            return true;
    }
    return path.GetAsString().size() > 2'000;  // PA1 has bounds, USD has none
}

void checkPath(std::string_view text) {
    const auto elements = specpath::parse(text);
    const usd::TfComplaints silent;
    const pxr::SdfPath path{std::string(text)};  // empty if the text is not a path
    const bool isUsds = !path.IsEmpty() && path.GetAsString() == text && isSpec(path);
    if (!elements) return require(!isUsds || isBeyondOurs(path), "PA1: a path of USD is accepted");
    require(isUsds, "PA1: an accepted path is a path of USD, and of a spec");
    std::string built = "/";
    for (const PathElement& element : *elements) {
        const std::string parent =
            std::exchange(built, specpath::child(built, element.list, element.name));
        require(specpath::isName(element.list, element.name), "PA2: elements are names");
        require(specpath::parent(built) == parent, "the parent of a child");
        require(specpath::last(built) == element, "the last element is the child's");
        require(specpath::hasPrefix(built, parent), "PA3: a child is below its parent");
        require(specpath::replacePrefix(built, parent, parent) == built, "a prefix by itself");
    }
    require(built == text, "the elements make up the path");
}

/// A project that contains links, one of which leads out of it.
class Folder {
public:
    Folder() {
        std::string name = (fs::temp_directory_path() / "usdlive-fuzz-XXXXXX").string();
        if (!::mkdtemp(name.data())) std::abort();
        path = name;
        fs::create_directories(path / "project" / "a");
        fs::create_directory_symlink(path, path / "project" / "o");
        fs::create_directory_symlink("a", path / "project" / "i");
        files = std::move(*server::createLayerFiles(path / "project", *blobs));
    }
    ~Folder() { fs::remove_all(path); }

    fs::path path;
    std::unique_ptr<server::BlobStore> blobs = server::createMemoryBlobStore();
    std::unique_ptr<server::LayerFiles> files;
};

void checkLayer(std::string_view text) {
    static const Folder folder;
    const auto layer = parseLayerId(text);
    const auto file = folder.files->resolve({std::string(text)});
    if (!layer) return require(!file, "LN1: a text that is no name has no file");
    if (!file) return;
    std::error_code problem;
    const fs::path real = fs::weakly_canonical(*file, problem);
    require(!problem && real == *file, "LN1: a file has one name");
    const fs::path inside = real.lexically_relative(folder.files->folder());
    require(!inside.empty() && *inside.begin() != "..", "LN1: a name leads into the project");
}

void checkFile(std::string_view text) {
    if (!checkFilePath(text)) return;
    require(!parseLayerId(text), "FI7: an uploaded file is no layer");
    const fs::path path(text);
    require(path.is_relative() && path.lexically_normal() == path, "FI7: a file has one name");
    for (const fs::path& part : path)
        require(!part.empty() && !part.native().starts_with('.'), "FI7: no file is hidden");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view text = asText({data, size});
    checkPath(text);
    checkLayer(text);
    checkFile(text);
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (const std::string_view text : {"/",
                                        "/A/B_1/C",
                                        "/A.x",
                                        "/A/B.ns:of:x",
                                        "/A{set=}",
                                        "/A{set=one}",
                                        "/A{set=one}B/C.x",
                                        "/A{set=.1-a|b}{in=two}.r",
                                        "/\xC3\x84h/\xE2\x82\xAC",
                                        "/A.r[/T]",
                                        "../A",
                                        "/A//B",
                                        "a.usda",
                                        "shot/010/a.usd",
                                        "i/b.usdc",
                                        "o/b.usda",
                                        "../a.usda",
                                        "/etc/a.usda",
                                        "a\\..\\b.usda",
                                        "%2e%2e/a.usda",
                                        ".usdlive/a.usda",
                                        "http://a/b.usda",
                                        "a/./b.usda",
                                        "tex/brick.png",
                                        "tex/.a/b.png"})
        all.push_back(copyOf(asBytes(text)));
    return all;
}
