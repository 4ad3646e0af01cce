// The commands that show composed stages.
#include "cli/ComposedCommands.h"

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "cli/Plugins.h"
#include "cli/StageDump.h"
#include "transport/Connection.h"
#include "usd/places/PlainFiles.h"  // encodedInAddress
#include "usd/stage/DepthGuard.h"
#include "usdlive/client/usd/stage/Flatten.h"
#include "usdlive/client/usd/stage/Stage.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::cli {

using nlohmann::json;
using stage::PrimFlag;

namespace {

constexpr std::chrono::seconds kServerTime{10};

Result<Revision> newestRevision(const client::ServerAddress& server) {
    const auto projects = client::listProjects(server, kServerTime);
    if (!projects) return tl::unexpected(projects.error());
    if (projects->areSeveral && server.project.empty())
        return fail(ErrorCode::InvalidArgument,
                    server.url() + " has several projects; use ws://HOST:PORT/PROJECT");
    for (const auto& project : projects->all)
        if (project.name == server.project || server.project.empty()) return project.revision;
    return fail(ErrorCode::NotConnected, server.url() + " is no project of this server");
}

/// Returns the address by which OpenUSD opens the layer. It names a revision, so that all layers of
/// the stage belong to it.
Result<std::string> addressOf(const ServedRoot& root) {
    client::ServerAddress server = root.target.server;
    if (server.dds)
        return fail(ErrorCode::InvalidArgument,
                    "stages are read over HTTP; name the server with ws://HOST:PORT");
    server.layer.clear();
    std::string address = server.url();
    address.replace(0, address.find(':'), "usdlive");
    address += "/" + client::encodedInAddress(root.target.layers.front().value) + "@";
    if (!root.checkpoint.empty())
        return address + percentEncodedIf(root.checkpoint,
                                          [](char c) { return c == '%' || c == '@' || c == '.'; });
    const auto revision = root.revision ? root.revision : newestRevision(server);
    if (!revision) return tl::unexpected(revision.error());
    return address + std::to_string(*revision);
}

Result<std::unique_ptr<stage::Stage>> openStage(const ComposedOptions& options) {
    const auto name = options.served ? addressOf(*options.served) : options.root;
    if (!name) return tl::unexpected(name.error());
    const auto root = stage::openLayer(*name);
    if (!root) return tl::unexpected(root.error());
    if (options.session.empty()) return std::make_unique<stage::Stage>(*root);
    const auto session = stage::openLayer(options.session);
    if (!session) return tl::unexpected(session.error());
    return std::make_unique<stage::Stage>(*root, *session);
}

Result<void> writeText(const std::string& text, const std::string& out) {
    if (out.empty()) {
        std::cout << text;
        return {};
    }
    std::ofstream stream(out, std::ios::binary);
    if (!(stream << text << std::flush))
        return fail(ErrorCode::StorageFailed,
                    "cannot write the file '" + out + "': " + std::strerror(errno));
    return {};
}

/// Writes the layer in the format that the name of the file says.
Result<void> writeLayer(const pxr::SdfLayer& layer, const std::string& out) {
    std::error_code ignored;
    const auto status = std::filesystem::status(out, ignored);
    // Export() replaces what has the name. A pipe or a device is written to, and gets text.
    if (out.empty() ||
        (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))) {
        std::string text;
        layer.ExportToString(&text);
        return writeText(text, out);
    }
    const usd::TfComplaints complaints;
    if (layer.Export(out)) return {};
    return fail(ErrorCode::StorageFailed, "cannot write the file '" + out +
                                              "': " + complaints.text("no format has this name"));
}

Result<void> dumpOne(ComposedOptions options) {
    auto opened = openStage(options);
    if (!opened) return tl::unexpected(opened.error());
    if (options.base.empty() && !options.served)
        options.base = std::filesystem::absolute(options.root).parent_path().string();
    const auto dump = dumpStage(**opened, {options.base, options.fold});
    return writeText(dump.dump(1, ' ', false, json::error_handler_t::replace) + "\n", options.out);
}

// Each line: root, session, base and output file, with tabs between them. A stage that cannot be
// opened is reported; the others are written.
Result<void> dumpBatch(const ComposedOptions& options) {
    std::ifstream list(options.batch);
    if (!list)
        return fail(ErrorCode::LayerUnreadable, "cannot read the file '" + options.batch + "'");
    std::size_t failures = 0;
    for (std::string line; std::getline(list, line);) {
        if (line.empty()) continue;
        ComposedOptions one;
        one.fold = options.fold;
        std::istringstream words(line);
        for (auto* word : {&one.root, &one.session, &one.base, &one.out})
            std::getline(words, *word, '\t');
        if (const auto done = dumpOne(one); !done) {
            std::cerr << done.error().message << "\n";
            ++failures;
        }
    }
    if (failures)
        return fail(ErrorCode::LayerUnreadable,
                    std::to_string(failures) + " stages of '" + options.batch + "' failed");
    return {};
}

json treeOf(const stage::Prim& prim) {
    json children = json::array();
    for (const auto& child : prim.children(stage::PrimPredicate::all().throughInstances()))
        children.push_back(treeOf(child));
    return {{"name", prim.name().GetString()},      {"path", prim.path().GetAsString()},
            {"type", prim.typeName().GetString()},  {"active", prim.has(PrimFlag::Active)},
            {"loaded", prim.has(PrimFlag::Loaded)}, {"defined", prim.has(PrimFlag::Defined)},
            {"instance", prim.isInstance()},        {"children", std::move(children)}};
}

void printTree(const stage::Prim& prim, std::size_t depth) {
    std::string notes;
    if (!prim.has(PrimFlag::Active)) notes += "  inactive";
    if (prim.has(PrimFlag::HasPayload) && !prim.has(PrimFlag::Loaded)) notes += "  unloaded";
    if (!prim.has(PrimFlag::HasDefiningSpecifier)) notes += "  over";
    if (prim.isInstance()) notes += "  instance";
    const std::string type = prim.typeName().GetString();
    std::cout << std::string(2 * depth, ' ') << prim.name().GetString()
              << (type.empty() ? "" : "  " + type) << notes << "\n";
    for (const auto& child : prim.children(stage::PrimPredicate::all().throughInstances()))
        printTree(child, depth + 1);
}

}  // namespace

Result<void> dumpComposed(const ComposedOptions& options) {
    registerPlugins();
    return options.batch.empty() ? dumpOne(options) : dumpBatch(options);
}

Result<void> treeComposed(const ComposedOptions& options) {
    registerPlugins();
    auto opened = openStage(options);
    if (!opened) return tl::unexpected(opened.error());
    const auto root = (*opened)->pseudoRoot();
    if (options.json) {
        std::cout << treeOf(root)["children"].dump(-1, ' ', false, json::error_handler_t::replace)
                  << "\n";
    } else {
        for (const auto& child : root.children(stage::PrimPredicate::all())) printTree(child, 0);
    }
    for (const auto& error : (*opened)->errors()) std::cerr << error.message << "\n";
    return {};
}

Result<void> flattenComposed(const ComposedOptions& options) {
    registerPlugins();
    auto opened = openStage(options);
    if (!opened) return tl::unexpected(opened.error());
    const auto layer = stage::flatten(**opened);
    for (const auto& error : (*opened)->errors()) std::cerr << error.message << "\n";
    return writeLayer(*layer, options.out);
}

}  // namespace usdlive::cli
