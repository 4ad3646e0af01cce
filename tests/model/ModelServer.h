// The server of the model.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "Explored.h"
#include "Scenario.h"
#include "project/Project.h"
#include "simulation/SimDisk.h"

namespace usdlive::model {

/// The content of a log, revision by revision (0 first).
struct History {
    std::vector<Hash> hashes;       ///< the chain hashes
    std::vector<Hash> contents;     ///< the hashes of the layer's content
    std::vector<Labels> committed;  ///< the committed labels up to each revision
};

/// The histories of a search, by their newest chain hash.
class Archive {
public:
    const History& of(const server::CommitStore& store);

private:
    std::map<Hash, History> histories_;
};

/// The real Project with its disk, and a simulated process that performs one requested action at a
/// time. Commits that the host was asked to append are volatile until Input::Flush. A copy is an
/// independent server.
class ModelServer {
public:
    struct Summary {
        const History* history = nullptr;  ///< the durable history
        std::size_t unsaved = 0;           ///< commits that are not durable
        std::size_t jobs = 0;              ///< jobs of the host that are not finished
        bool loadedIsStored = false;  ///< the project's layer, if loaded, has the durable content
    };

    ModelServer(const Scenario& scenario, Messages& messages, Archive& archive);
    ModelServer(const ModelServer& other);
    ~ModelServer();

    std::vector<Output> apply(Input input);
    void digest(Digest& out) const;
    [[nodiscard]] Summary summary() const;

private:
    // Requests of the project to its host.
    struct LoadLayer {};
    struct ReadCommits {
        server::SessionId session = 0;
        Revision from = 0, to = 0;
    };
    struct ReadClient {
        ClientId client;
    };
    struct SendSnapshot {
        server::SessionId session = 0;
        std::uint64_t request = 0;
        LayerDoc doc;
    };
    struct OpenStoreAnew {};
    using Job = std::variant<LoadLayer, ReadCommits, ReadClient, SendSnapshot, OpenStoreAnew>;
    friend void digest(Digest& out, const ReadCommits& part);
    friend void digest(Digest& out, const ReadClient& part);
    friend void digest(Digest& out, const SendSnapshot& part);

    class Host;

    [[nodiscard]] const server::CommitStore& store() const { return disk_->store(); }
    simulation::SimDisk& disk();
    void start();
    [[nodiscard]] server::Project::Options options() const;
    [[nodiscard]] std::unique_ptr<server::Project::Impl> newProject(server::StoreState state) const;
    void flush(std::size_t commits);
    void write(std::size_t commits);
    void diskFull();
    void diskFails(std::size_t written);
    void answer(std::size_t job);
    void done(const LoadLayer&);
    void done(const ReadCommits& job);
    void done(const ReadClient& job);
    void done(const SendSnapshot& job);
    void done(const OpenStoreAnew&);

    const Scenario& scenario_;
    Messages& messages_;
    Archive& archive_;
    std::vector<Output> outputs_;

    std::shared_ptr<simulation::SimDisk> disk_;  // shared by copies until one of them changes it
    std::deque<server::CommitRecord> appends_;
    std::size_t reported_ = 0;  // how many were reported too early: Flaw::AcksEarly
    std::vector<Job> jobs_;
    std::shared_ptr<Host> host_;  // shared by all copies: a project keeps its host
    std::unique_ptr<server::Project::Impl> project_;
};

}  // namespace usdlive::model
