// usdlive-server: what the server is made of, from the outside in.

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <chrono>
#include <fstream>
#include <iostream>
#include <set>
#include <span>

#include "usdlive/server/app/Metrics.h"
#include "usdlive/server/app/Options.h"
#include "usdlive/server/app/ProjectRuntime.h"
#include "usdlive/server/app/RunningServer.h"
#include "usdlive/server/app/SharedStore.h"
#include "usdlive/server/app/SpdLog.h"
#include "usdlive/server/app/StorageThread.h"
#include "usdlive/server/files/LayerFiles.h"
#include "usdlive/server/project/Project.h"
#include "usdlive/server/storage/BlobStore.h"
#include "usdlive/server/storage/RocksCommitStore.h"
#include "usdlive/server/transport/DdsServer.h"
#include "usdlive/server/transport/WebSocketServer.h"

// jemalloc reads this: freed memory goes back to the system within a second, also while nothing
// happens. What an import or a save took is else still held when its result takes as much again.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0";
}

namespace {

using namespace usdlive;
using namespace usdlive::server;
namespace asio = boost::asio;

constexpr std::uint64_t kMib = 1024 * 1024;
constexpr int kStartError = 1;
constexpr std::size_t kMostSkippedLogged = 100;
// A message holds its frames and their lengths.
constexpr std::size_t kMessageSlack = 64 * 1024;
// Beside sessions there are /metrics, /healthz, and those that are told that there are too many.
constexpr std::size_t kMoreConnections = 256;
// After this a stop that hangs, in a file system that does not answer, ends the hard way. Nothing
// that was acknowledged is lost by it.
constexpr unsigned kStopSeconds = 10;

std::int64_t wallClockMs() {
    using namespace std::chrono;
    return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

/// What is served: the files, and the layers that only the store holds by now.
Result<std::vector<LayerFile>> servedLayers(const LayerFiles& files, SharedStore& store) {
    auto listed = files.list();
    if (!listed) return listed;
    const auto stored = store.use([](CommitStore& opened) { return opened.layers(); });
    if (!stored) return tl::unexpected(stored.error());
    std::map<LayerId, LayerFile> all;
    for (LayerFile& file : *listed) all.emplace(file.layer, std::move(file));
    for (const LayerId& layer : *stored) all.try_emplace(layer, LayerFile{layer});
    std::vector<LayerFile> served;
    for (auto& [layer, file] : all) served.push_back(std::move(file));
    return served;
}

ProjectSetup projectSetup(const ServerOptions& options, SharedStore& store,
                          const LayerFiles& files) {
    Project::Options project;
    project.name = std::filesystem::canonical(options.folder).filename().string();
    project.maxFrameBytes = project.wholeCommitBytes = options.maxFrameMib * kMib;
    project.maxBlobBytes = options.maxBlobMib * kMib;
    project.maxTransactionBytes = options.maxTransactionMib * kMib;
    project.maxSessions = options.maxSessions;
    for (const std::string& user : options.administrators) project.administrators.insert({user});
    project.historyDays = options.historyDays;
    project.lockTakeoverMs = std::int64_t(options.lockTakeoverMinutes) * 60'000;
    project.keepUnusedBlobsMs = std::int64_t(options.keepUnusedBlobsMinutes) * 60'000;
    const auto read = [=, &store, &files]() -> Result<ProjectBeginning> {
        auto served = servedLayers(files, store);
        if (!served) return tl::unexpected(served.error());
        return store.use([&](CommitStore& opened) { return readState(opened, project); })
            .map([&](StoreState&& state) {
                return ProjectBeginning{std::move(state), std::move(*served)};
            });
    };
    return {project, read};
}

WebSocketServerOptions transportOptions(const ServerOptions& options) {
    WebSocketServerOptions transport;
    transport.host = options.host;
    transport.port = options.port;
    transport.maxMessageBytes = options.maxFrameMib * kMib + kMessageSlack;
    transport.maxConnections = options.maxSessions + kMoreConnections;
    transport.slowReaderBytes = options.slowReaderMib * kMib;
    transport.allowedOrigins = options.allowedOrigins;
    return transport;
}

DdsServerOptions ddsOptions(const ServerOptions& options, std::string url, Revision revision) {
    DdsServerOptions transport;
    transport.domain = {options.ddsInterface, std::uint32_t(options.ddsDomain), options.ddsConfig,
                        options.ddsSecurity};
    transport.project = std::filesystem::canonical(options.folder).filename().string();
    transport.url = std::move(url);
    transport.revision = revision;
    transport.maxMessageBytes = options.maxFrameMib * kMib + kMessageSlack;
    transport.maxSessions = options.maxSessions + kMoreConnections;
    transport.slowReaderBytes = options.slowReaderMib * kMib;
    return transport;
}

/// Writes the file whole or not at all, since others wait for it to appear.
Result<void> writePortFile(const std::filesystem::path& path, std::uint16_t port) {
    const std::filesystem::path draft = path.string() + ".new";
    std::ofstream file(draft);
    file << port << '\n';
    file.close();
    std::error_code error;
    if (file) std::filesystem::rename(draft, path, error);
    if (!file || error)
        return fail(ErrorCode::InvalidConfiguration, "cannot write " + path.string());
    return {};
}

int failed(const Error& error) {
    std::cerr << "usdlive-server: " << error.message << '\n';
    return kStartError;
}

/// Names the server that has the folder's store open, if that is what is wrong, and says what to do
/// about a damaged one.
/// A server that runs never makes a new history in the place of the one it has served.
Result<std::unique_ptr<CommitStore>> openStore(const std::filesystem::path& folder,
                                               const RocksCommitStoreOptions& options,
                                               bool& wasOpened) {
    std::error_code error;
    if (wasOpened && !std::filesystem::exists(folder / "store" / "head", error))
        return fail(ErrorCode::StorageFailed,
                    "the project's history " + folder.lexically_normal().string() +
                        " was deleted or moved while the server runs. Put it back, and editing "
                        "goes on. If it is lost, export what open editors show, then stop the "
                        "server and start it again: the project begins with its files as they "
                        "were saved last");
    auto opened = createRocksCommitStore(folder / "store", options);
    wasOpened = wasOpened || opened.has_value();
    return opened;
}

Error explained(const Error& error, const std::filesystem::path& folder) {
    const std::string history = (folder / ".usdlive").lexically_normal().string();
    if (error.code == ErrorCode::StorageCorrupt)
        return {
            error.code,
            error.message + ". The project's history in " + history +
                " is damaged. Put a backup of it in its place. If there is none, move it aside "
                "(mv " +
                history + " " + history +
                "-damaged) and start again: the project then begins with its files, as they were "
                "saved last"};
    if (error.code != ErrorCode::StorageLocked) return error;
    const auto running = RunningServer::find(folder);
    if (!running) return error;
    return {error.code, folder.string() + " is already served at " + running->url + " by process " +
                            std::to_string(running->process) +
                            ". Connect there, or stop that process first"};
}

/// FI5. How many files are not served; the first are logged with the reason.
std::size_t logSkipped(const LayerFiles& files, Log& log) {
    const auto skipped = files.skipped();
    if (!skipped) return 0;
    for (const SkippedFile& file :
         std::span(*skipped).first(std::min(skipped->size(), kMostSkippedLogged)))
        log.write(LogLevel::Warning, "file skipped",
                  {{"file", file.path}, {"reason", file.reason}});
    if (skipped->size() > kMostSkippedLogged)
        log.write(LogLevel::Warning, "more files skipped",
                  {{"count", skipped->size() - kMostSkippedLogged}});
    return skipped->size();
}

/// What people read when the server is ready.
void announce(const ServerOptions& options, std::uint16_t port, std::size_t layers,
              std::size_t skipped) {
    std::cout << "serving " << options.folder.string() << " (" << layers
              << (layers == 1 ? " layer" : " layers");
    if (skipped > 0)
        std::cout << "; " << skipped << (skipped == 1 ? " file is" : " files are")
                  << " skipped, `usdlive ls --skipped` says why";
    std::cout << ")";
    const char* before = " at ";
    for (const std::string& url : reachableUrls(options.host, port))
        std::cout << std::exchange(before, ", ") << url;
    std::cout << std::endl;
    if (layers == 0)
        std::cout
            << "It holds no .usd, .usda or .usdc file yet. Put one there: it is served within "
               "a second."
            << std::endl;
}

int serve(const ServerOptions& options) {
    if (!std::filesystem::is_directory(options.folder))
        return failed(
            {ErrorCode::InvalidConfiguration, options.folder.string() + " is not a folder"});
    const auto log = createSpdLog(options.logLevel, options.logFormat);

    // Disk.
    const auto storeFolder = options.folder / ".usdlive";
    RocksCommitStoreOptions storeOptions;
    BlobStoreOptions blobOptions;
    if (options.durability == "os") storeOptions.durability = Durability::OperatingSystem;
    if (options.minFreeMib)
        storeOptions.minFreeBytes = blobOptions.minFreeBytes = *options.minFreeMib * kMib;
    blobOptions.maxBytes = options.maxBlobMib * kMib;
    bool wasOpened = false;
    SharedStore store([&] { return openStore(storeFolder, storeOptions, wasOpened); });
    if (const auto opened = store.open(); !opened)
        return failed(explained(opened.error(), options.folder));
    auto blobs = createFileBlobStore(storeFolder / "blobs", blobOptions);
    if (!blobs) return failed(blobs.error());
    auto files = createLayerFiles(options.folder, **blobs);
    if (!files) return failed(files.error());

    // Threads: this one for the network and the project, one that appends, some that read and
    // write.
    asio::io_context network(1);
    WorkerLanes workers;
    StorageThread storage(store, std::chrono::milliseconds(options.flushIntervalMs), *log);
    Metrics metrics;

    // The project, and who carries its messages.
    LayerFiles& layerFiles = **files;
    ProjectFiles projectFiles{std::filesystem::canonical(options.folder),
                              [&] { return servedLayers(layerFiles, store); }, layerFiles};
    ProjectRuntime runtime(network, workers, store, storage, **blobs, std::move(projectFiles),
                           std::chrono::minutes(options.keepUnusedBlobsMinutes), metrics,
                           wallClockMs, *log);
    if (const auto made = runtime.start(projectSetup(options, store, **files)); !made)
        return failed(made.error());
    HttpRoutes routes;
    routes["/healthz"] = [&] { return runtime.health(); };
    routes["/metrics"] = [&] { return runtime.metricsPage(); };
    const Background background = [&](std::function<void()> job) {
        asio::post(workers.joins, std::move(job));
    };
    auto transport = createWebSocketServer(network, transportOptions(options), runtime,
                                           std::move(routes), background, *log);
    if (!transport) return failed(transport.error());
    const std::uint16_t port = (*transport)->port();
    std::unique_ptr<Transport> ddsTransport;
    if (options.dds) {
        dds::setDomainLog([&](bool isError, std::string_view message) {
            log->write(isError ? LogLevel::Error : LogLevel::Warning, "DDS", {{"says", message}});
        });
        auto made = createDdsServer(network,
                                    ddsOptions(options, reachableUrls(options.host, port).front(),
                                               runtime.durableRevision()),
                                    runtime, background, *log);
        if (!made) return failed(made.error());
        ddsTransport = std::move(*made);
    }
    std::vector<Transport*> transports{transport->get()};
    if (ddsTransport) transports.push_back(ddsTransport.get());
    runtime.serve(std::move(transports));

    // Until somebody says stop.
    asio::signal_set signals(network, SIGINT, SIGTERM);
    signals.async_wait([&](const boost::system::error_code& error, int) {
        if (error) return;
        ::alarm(kStopSeconds);
        log->write(LogLevel::Info, "stopping");
        runtime.stop([&] { network.stop(); });
    });

    if (!(*transport)->isLoopback())
        log->write(LogLevel::Warning,
                   "anyone who reaches this address can read and edit: there is no "
                   "authentication yet",
                   {{"host", options.host}});
    if (!options.portFile.empty())
        if (const auto written = writePortFile(options.portFile, port); !written)
            return failed(written.error());
    const RunningServer running(options.folder, reachableUrls(options.host, port).front());
    const auto layers = servedLayers(**files, store);
    announce(options, port, layers ? layers->size() : 0, logSkipped(**files, *log));

    network.run();
    ddsTransport.reset();
    dds::setDomainLog(nullptr);
    transport->reset();
    workers.stop();
    storage.stop();
    store.close();
    log->write(LogLevel::Info, "stopped");
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    ::signal(SIGPIPE, SIG_IGN);
    const auto options = parseOptions(argc, argv);
    if (const int* code = std::get_if<int>(&options)) return *code;
    try {
        return serve(std::get<ServerOptions>(options));
    } catch (const std::exception& fault) {
        std::cerr << "usdlive-server: " << fault.what() << '\n';
        return kStartError;
    }
}
