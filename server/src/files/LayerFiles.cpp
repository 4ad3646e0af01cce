// Lists, imports and saves the USD files of a project.
#include "files/LayerFiles.h"

#include <fcntl.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <future>
#include <mutex>

#include "files/BigArrays.h"
#include "files/BlobBridge.h"
#include "files/FileStamps.h"
#include "files/FolderWalk.h"
#include "files/OpenLayerFile.h"
#include "files/OpenLayerFiles.h"
#include "files/SafeFile.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/protocol/ServerControl.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

std::string lowerCase(std::string text) {
    for (char& c : text)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return text;
}

// Returns true for the extensions that OpenUSD reads as layers. It ignores case.
bool looksLikeLayer(const std::string& name) {
    const std::string ending = lowerCase(fs::path(name).extension().string());
    return ending == ".usd" || ending == ".usda" || ending == ".usdc" || ending == ".usdz";
}

std::string whyNoLayer(const std::string& name, const Error& error) {
    if (lowerCase(fs::path(name).extension().string()) == ".usdz")
        return "a package is read-only: unpack it to edit what it holds (usdzip, usdunzip)";
    return error.message + ": rename it";
}

// Replaces bytes that are not UTF-8 by U+FFFD.
std::string shownName(std::string_view name) {
    std::string shown;
    while (!name.empty()) {
        const std::string_view before = name;
        if (takeCodePoint(name)) {
            shown += before.substr(0, before.size() - name.size());
        } else {
            shown += "\xEF\xBF\xBD";
            name.remove_prefix(1);
        }
    }
    return shown;
}

// The attempts to import a file that another process writes meanwhile. Clients request it again
// later.
constexpr int kImportAttempts = 3;

bool isHidden(const fs::path& path) { return path.filename().native().starts_with('.'); }

// Calls `visit` for every file in the folder and below, without following links.
Result<void> forEachFile(const fs::path& folder, const auto& visit) {
    std::error_code problem;
    auto entry = fs::recursive_directory_iterator(
        folder, fs::directory_options::skip_permission_denied, problem);
    while (!problem && entry != fs::recursive_directory_iterator()) {
        std::error_code ignored;
        const auto type = entry->symlink_status(ignored).type();
        if (type == fs::file_type::directory && isHidden(entry->path()))
            entry.disable_recursion_pending();
        if (type == fs::file_type::regular) visit(entry->path());
        entry.increment(problem);
    }
    if (!problem) return {};
    return fail(ErrorCode::LayerUnreadable,
                "the folder " + folder.string() + " cannot be listed: " + problem.message());
}

// FI5: bounds the list of layers that clients are sent.
class LayerLimit {
public:
    bool admits(const std::string& name) {
        ++count_;
        bytes_ += name.size();
        return count_ <= kMaxLayers && bytes_ <= kMaxLayerNameBytes;
    }

private:
    std::size_t count_ = 0, bytes_ = 0;
};

/// Calls `visit(LayerId, real path)` for each layer that is served (FI5).
Result<void> forEachLayer(const fs::path& folder, const auto& visit) {
    LayerLimit limit;
    return walkFolder(folder, {[&](const std::string& name, const fs::path& real) {
                                   auto layer = parseLayerId(name);
                                   if (layer && limit.admits(name)) visit(*std::move(layer), real);
                               },
                               [](const std::string&, const std::string&) {}});
}

class SdfLayerFiles final : public LayerFiles {
public:
    SdfLayerFiles(fs::path folder, BlobStore& blobs) : folder_(std::move(folder)), blobs_(blobs) {}

    const fs::path& folder() const override { return folder_; }

    Result<std::vector<LayerFile>> list() const override {
        std::vector<LayerFile> layers;
        const auto listed = forEachLayer(folder_, [&](LayerId&& layer, const fs::path& real) {
            if (auto file = lookAt(real, std::move(layer))) layers.push_back(*std::move(file));
        });
        if (!listed) return tl::unexpected(listed.error());
        std::ranges::sort(layers, {}, &LayerFile::layer);
        return layers;
    }

    Result<std::vector<SkippedFile>> skipped() const override {
        std::vector<SkippedFile> skipped;
        LayerLimit limit;
        const FolderVisitor visitor{
            [&](const std::string& name, const fs::path&) {
                if (!looksLikeLayer(name)) return;
                if (const auto layer = parseLayerId(name); !layer)
                    skipped.push_back({shownName(name), whyNoLayer(name, layer.error())});
                else if (!limit.admits(name))
                    skipped.push_back({shownName(name),
                                       "the project has too many layers: serve "
                                       "a part of the folder"});
            },
            [&](const std::string& name, const std::string& reason) {
                // A link to a texture outside is not a layer.
                if (looksLikeLayer(name) || !fs::path(name).has_extension())
                    skipped.push_back({shownName(name), reason});
            }};
        if (auto walked = walkFolder(folder_, visitor); !walked)
            return tl::unexpected(walked.error());
        std::ranges::sort(skipped, {}, &SkippedFile::path);
        return skipped;
    }

    Result<fs::path> resolve(const LayerId& layer) const override {
        if (auto valid = parseLayerId(layer.value); !valid) return tl::unexpected(valid.error());
        fs::path path = folder_;
        for (const fs::path& part : fs::path(layer.value)) {
            path /= part;
            std::error_code problem;
            if (fs::symlink_status(path, problem).type() != fs::file_type::symlink) continue;
            const fs::path real = fs::canonical(path, problem);
            if (problem)
                return fail(ErrorCode::InvalidLayerName,
                            layer.value + " is reached over a broken link");
            if (const std::string why = whyOutside(folder_, real); !why.empty())
                return fail(ErrorCode::InvalidLayerName,
                            layer.value + " is reached over a link that leads " + why);
            path = real;
        }
        return path;
    }

    Result<void> create(const LayerId& layer) override {
        const auto path = resolve(layer);
        if (!path) return tl::unexpected(path.error());
        const auto objection = [&]() -> Result<void> {
            std::error_code ignored;
            if (fs::symlink_status(*path, ignored).type() == fs::file_type::not_found) return {};
            return fail(ErrorCode::LayerExists, "a file " + layer.value +
                                                    " is in the project's folder already: open "
                                                    "it, or choose another name");
        };
        auto made = objection().and_then([&] { return write(*path, LayerDoc(), objection, {}); });
        if (made) return {};
        if (made.error().code == ErrorCode::LayerExists) return tl::unexpected(made.error());
        return fail(ErrorCode::SaveFailed,
                    layer.value + " could not be created: " + made.error().message);
    }

    Result<ImportedLayer> import(const LayerId& layer) override {
        const auto path = resolve(layer);
        if (!path) return tl::unexpected(path.error());
        std::error_code ignored;
        const auto type = fs::status(*path, ignored).type();
        if (type == fs::file_type::not_found)
            return fail(ErrorCode::LayerNotFound, "the project has no file " + layer.value);
        if (type != fs::file_type::regular)
            return layerUnreadable(layer, "it is not a regular file");
        for (int left = kImportAttempts; left > 0; --left) {
            const auto before = stampOf(*path);
            if (!before) return tl::unexpected(before.error());
            auto doc = read(layer, *path);
            const auto after = lookAt(*path, layer);
            if (!*before || !after || after->trace != (*before)->trace) continue;
            if (!doc) return tl::unexpected(doc.error());
            return ImportedLayer{*std::move(doc), **before};
        }
        return layerUnreadable(layer, "it is being written at this moment");
    }

    Result<std::optional<FileStamp>> stamp(const LayerId& layer) const override {
        return resolve(layer).and_then([](const fs::path& path) { return stampOf(path); });
    }

    Result<FileStamp> save(const LayerId& layer, const LayerDoc& doc,
                           const std::vector<Hash>& expected, const Ready& ready) override {
        const auto path = resolve(layer);
        if (!path) return tl::unexpected(path.error());
        // Set when the file was accepted, so that a big file is hashed once.
        std::optional<FileTrace> unobjectionable;
        const auto objection = [&]() -> Result<void> {
            if (expected.empty()) return {};
            const auto present = lookAt(*path, layer);
            if (present && present->trace && present->trace == unobjectionable) return {};
            const auto found = stampOf(*path);
            if (!found) return tl::unexpected(found.error());
            if (*found) unobjectionable = (*found)->trace;
            if (!*found || std::ranges::find(expected, (*found)->hash) != expected.end()) return {};
            // An editor may have written the same content in its own format.
            if (const auto held = read(layer, *path); held && *held == doc) return {};
            unobjectionable.reset();
            return fail(ErrorCode::LayerOutdated,
                        layer.value + " was changed on the disk: reload it, or force the save");
        };
        auto saved = objection().and_then([&] { return write(*path, doc, objection, ready); });
        if (saved || saved.error().code == ErrorCode::LayerOutdated) return saved;
        return fail(ErrorCode::SaveFailed,
                    layer.value + " could not be saved: " + saved.error().message);
    }

    Result<Bytes> render(const LayerId& layer, const LayerDoc& doc) override {
        if (lowerCase(fs::path(layer.value).extension().string()) == ".usda") {
            StoredBlobs blobs(blobs_);
            return usd::exportText(doc, blobs).map([](const std::string& text) {
                const ByteView bytes = asBytes(text);
                return Bytes(bytes.begin(), bytes.end());
            });
        }
        // OpenUSD writes the binary format to files only.
        std::string name = (fs::temp_directory_path() / "usdlive-XXXXXX.usdc").string();
        const Descriptor file(::mkostemps(name.data(), int(std::strlen(".usdc")), O_CLOEXEC));
        if (!file)
            return fail(ErrorCode::SaveFailed,
                        std::string("no temporary file can be created: ") + std::strerror(errno));
        auto written = exportWhole(name, doc, "usdc").and_then([&] { return readFile(name); });
        ::unlink(name.c_str());
        if (written) return written;
        std::string why = written.error().message;  // names the temporary file (FR12)
        for (std::size_t at; (at = why.find(name)) != std::string::npos;)
            why.replace(at, name.size(), layer.value);
        return fail(written.error().code, std::move(why));
    }

private:
    static Result<Bytes> readFile(const std::string& name) {
        std::error_code problem;
        const std::uintmax_t size = fs::file_size(name, problem);
        Bytes bytes(problem ? 0 : std::size_t(size));
        std::ifstream file(name, std::ios::binary);
        errno = 0;
        if (!bytes.empty() &&
            file.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(bytes.size())))
            return bytes;
        const std::string why = problem         ? problem.message()
                                : bytes.empty() ? "it is empty"
                                                : std::strerror(errno);
        return fail(ErrorCode::SaveFailed, name + " cannot be read: " + why);
    }

    Result<LayerDoc> read(const LayerId& layer, const fs::path& path) {
        const auto opened = openLayerFile(layer, path);
        if (!opened) return tl::unexpected(opened.error());
        BlobKeeper keeper(blobs_, importing_);
        auto doc = usd::readLayer(*opened, keeper);
        if (!keeper.kept()) return tl::unexpected(keeper.kept().error());
        if (!doc) return layerUnreadable(layer, doc.error().message);
        if (auto harmless = checkHarmless(*doc); !harmless)
            return layerUnreadable(layer, harmless.error().message);
        return doc;
    }

    // D1, which a file can violate but an edit cannot.
    static Result<void> checkHarmless(const LayerDoc& doc) {
        constexpr const char* kField = "timeCodesPerSecond";
        const FieldValue* value = doc.field("/", kField);
        if (!value) return {};
        LayerDoc copy = doc;
        const auto set = copy.apply("/", SetField{kField, {}, *value});
        if (!set) return tl::unexpected(set.error());
        return {};
    }

    // Returns the format for the file name: "usda" or "usdc".
    static std::string formatOf(const fs::path& path) {
        const std::string ending = lowerCase(path.extension().string());
        if (ending == ".usda") return "usda";
        std::error_code ignored;
        const auto text = pxr::SdfFileFormat::FindById(pxr::TfToken("usda"));
        const bool isText =
            ending == ".usd" && fs::exists(path, ignored) && text && text->CanRead(path.string());
        return isText ? "usda" : "usdc";
    }

    Result<FileStamp> write(const fs::path& path, const LayerDoc& doc,
                            const std::function<Result<void>()>& objection, const Ready& ready) {
        const std::string format = formatOf(path);
        return makeFolders(path.parent_path())
            .and_then([&] { return SafeFile::create(path, kTemporaryPrefix, format); })
            .and_then([&](SafeFile file) -> Result<FileStamp> {
                const auto written = exportTo(file.temporary(), doc, format);
                if (!written) return tl::unexpected(written.error());
                if (!*written)
                    return fail(ErrorCode::SaveFailed, "the written file cannot be read back");
                const auto last = [&] {
                    return ready ? ready((*written)->hash).and_then(objection) : objection();
                };
                if (auto done = file.replace(last); !done) return tl::unexpected(done.error());
                return stampInPlace(path, **written);
            });
    }

    // Renaming changed the trace. If another file has replaced ours since, keeping our trace shows
    // it.
    static FileStamp stampInPlace(const fs::path& path, FileStamp written) {
        const auto present = lookAt(path, {});
        if (!present) return written;
        FileTrace trace = *present->trace;
        trace.changedNs = written.trace.changedNs;
        if (trace == written.trace) written.trace = *present->trace;
        return written;
    }

    static Result<void> makeFolders(const fs::path& folder) {
        std::error_code problem;
        fs::create_directories(folder, problem);
        if (!problem) return {};
        return fail(ErrorCode::SaveFailed, "its folder cannot be created: " + problem.message());
    }

    // Writes the doc and checks that it can be read back. Returns nothing if another process writes
    // the file, too.
    Result<std::optional<FileStamp>> exportTo(const fs::path& file, const LayerDoc& doc,
                                              const std::string& format) {
        if (format == "usda") {
            const auto written = writeTextInParts(file, doc, blobs_);
            if (!written) return tl::unexpected(written.error());
            if (*written) return stampOf(file);
        }
        if (auto done = exportWhole(file, doc, format); !done) return tl::unexpected(done.error());
        startWritingBack(file);  // while it is checked
        // Both hash the whole content, which takes most of the time, so they run in parallel.
        // If the system refuses a thread, get() hashes it.
        constexpr auto kHow = std::launch::async | std::launch::deferred;
        auto stamp = std::async(kHow, [&file] { return stampOf(file); });
        if (auto same = compare(file, doc); !same) return tl::unexpected(same.error());
        return stamp.get();
    }

    // Releases the layer before its file is read, so that only one of them is in memory.
    Result<void> exportWhole(const fs::path& file, const LayerDoc& doc, const std::string& format) {
        StoredBlobs blobs(blobs_);
        const auto layer = usd::makeLayer(doc, blobs, format);
        if (!layer) return tl::unexpected(layer.error());
        const usd::TfComplaints complaints;
        errno = 0;
        if ((*layer)->Export(file.string()) && !complaints.hasErrors()) return {};
        return fail(ErrorCode::SaveFailed, complaints.text(std::strerror(errno)));
    }

    // Checks that the file has the right content.
    Result<void> compare(const fs::path& file, const LayerDoc& doc) {
        const usd::TfComplaints complaints;
        const auto written = pxr::SdfLayer::OpenAsAnonymous(file.string());
        if (!written)
            return fail(ErrorCode::SaveFailed, "the written file cannot be read back: " +
                                                   complaints.text("OpenUSD gives no reason"));
        if (usd::holds(written, doc)) return {};
        return compareTexts(*written, doc);
    }

    // A file may express the same in another way, for example with another number type in a
    // dictionary. Such layers are compared as text.
    Result<void> compareTexts(const pxr::SdfLayer& written, const LayerDoc& doc) {
        StoredBlobs blobs(blobs_);
        const auto layer = usd::makeLayer(doc, blobs, "usda");
        if (!layer) return tl::unexpected(layer.error());
        const usd::TfComplaints complaints;
        std::string is, ought;
        if (!written.ExportToString(&is) || !(*layer)->ExportToString(&ought))
            return fail(ErrorCode::SaveFailed, "the written file cannot be read back: " +
                                                   complaints.text("OpenUSD gives no reason"));
        if (is == ought) return {};
        return fail(ErrorCode::SaveFailed,
                    "the written file reads back differently" + differenceOf(is, ought));
    }

    static std::string differenceOf(const std::string& is, const std::string& ought) {
        const auto [at, unused] = std::ranges::mismatch(is, ought);
        const auto line = std::count(is.begin(), at, '\n') + 1;
        return ", from line " + std::to_string(line) + " of its text on";
    }

    const fs::path folder_;
    BlobStore& blobs_;
    std::mutex importing_;  // a blob has one writer
};

void removeLeftovers(const fs::path& folder) {
    std::vector<fs::path> leftovers;
    (void)forEachFile(folder, [&](const fs::path& path) {
        if (path.filename().native().starts_with(kTemporaryPrefix)) leftovers.push_back(path);
    });
    std::error_code ignored;
    for (const auto& path : leftovers) fs::remove(path, ignored);
}

}  // namespace

Result<std::vector<LayerId>> layersIn(const fs::path& folder) {
    std::error_code error;
    const fs::path real = fs::canonical(folder, error);
    std::vector<LayerId> layers;
    const auto listed = forEachLayer(error ? folder : real, [&](LayerId&& layer, const fs::path&) {
        layers.push_back(std::move(layer));
    });
    if (!listed) return tl::unexpected(listed.error());
    return layers;
}

Result<std::unique_ptr<LayerFiles>> openLayerFiles(const fs::path& folder, BlobStore& blobs) {
    std::error_code problem;
    const fs::path real = fs::canonical(folder, problem);
    if (problem || !fs::is_directory(real))
        return fail(ErrorCode::InvalidConfiguration,
                    folder.string() + " is not a folder that can be served");
    return std::make_unique<SdfLayerFiles>(real, blobs);
}

Result<std::unique_ptr<LayerFiles>> createLayerFiles(const fs::path& folder, BlobStore& blobs) {
    auto files = openLayerFiles(folder, blobs);
    if (files) removeLeftovers((*files)->folder());
    return files;
}

}  // namespace usdlive::server
