// Runs one seed of the simulation and checks its end.
#include "SimWorld.h"

#include <algorithm>
#include <array>
#include <memory>

#include "SimClient.h"
#include "SimText.h"
#include "UndoCheck.h"
#include "project/CommitContent.h"
#include "session/Reversal.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::simulation {

namespace {

constexpr std::int64_t kSecondUs = 1'000'000;

class World {
public:
    // Independent of random_, so that the seeds that failed once still produce the same run.
    explicit World(std::uint64_t seed)
        : seed_(seed),
          random_(seed),
          ages_(~seed),
          histories_(seed ^ 0x1d),
          rights_(seed ^ 0xac),
          kind_(seed % 5),
          style_(style()),
          server_(makeServer(seed)) {
        server_.slowness = random_.chance(20) ? 10 : 1;
        if (changesRights(seed)) server_.signUsersIn();
        if (random_.chance(40)) {
            network_.ddsPercent = random_.chance(50) ? 100 : 50;
            network_.ddsLossPercent = unsigned(random_.below(16));
        }
    }

    SimReport play() {
        server_.start();
        begin();
        const std::int64_t end = random_.between(kSecondUs / 2, 3 * kSecondUs);
        planFaults(end);
        while (clock_.nowUs() < end) require(clock_.step(), "nothing happens any more");
        becomeQuiet();
        check();
        return report_;
    }
    [[nodiscard]] std::string describe() const {
        std::string text = "at " + std::to_string(clock_.nowMs()) + " ms, store at revision " +
                           std::to_string(server_.store().head().revision) + "\n";
        for (const auto& client : clients_) text += client->describe() + "\n";
        return text;
    }

private:
    /// True if the server unloads layers as soon as nobody has them open. Uses no random number, so
    /// that the seeds that failed once still produce the same run.
    static bool unloads(std::uint64_t seed) { return seed % 4 == 0; }

    /// True if clients move prims in all layers. Uses no random number, and is false for all seeds
    /// that failed once before these edits were added.
    static bool editsNamespace(std::uint64_t seed) { return seed % 13 >= 6 && seed % 13 <= 9; }

    /// True if clients undo. Uses no random number, and is false for all seeds that failed once
    /// before.
    static bool undoes(std::uint64_t seed) {
        constexpr std::array kNot{0u,  4u,  8u,  9u,  11u, 15u, 17u, 18u, 22u, 27u,
                                  30u, 32u, 36u, 39u, 43u, 50u, 51u, 52u, 53u, 54u};
        return !editsNamespace(seed) && std::ranges::find(kNot, seed % 63) == kNot.end();
    }

    /// True if roles and rules change. Uses no random number, and is false for all seeds that
    /// failed once before.
    static bool changesRights(std::uint64_t seed) {
        constexpr std::array kSome{1u, 3u, 7u, 12u, 16u, 24u};
        return std::ranges::find(kSome, seed % 31) != kSome.end();
    }

    SimStyle style() {
        SimStyle style;
        const char* const names[] = {"root.usda", "shot/anim.usda", "look.usdc"};
        const auto count = 1 + random_.below(3);
        for (std::size_t index = 0; index < count; ++index) style.layers.push_back({names[index]});
        if (seed_ % 8 == 3) {
            style.newLayer = {"new/layer.usda"};
            style.layers.push_back(*style.newLayer);
        }
        style.editPercent = unsigned(random_.between(5, 60));
        style.gesturePercent = random_.chance(60) ? unsigned(random_.between(1, 10)) : 0;
        style.openPercent = unsigned(random_.between(1, 8));
        style.cutPerMille = random_.chance(60) ? unsigned(random_.between(1, 15)) : 0;
        style.requestPerMille = random_.chance(30) ? 10 : 0;
        style.lockPerMille = random_.chance(25) ? 20 : 0;
        style.namespacePercent = editsNamespace(seed_) ? 30 : 0;
        style.awayPerMille = random_.chance(5) ? 10 : 0;
        style.bigValues = random_.chance(20);
        style.smallBudgets = random_.chance(40);
        style.inParts = inParts();
        style.slidesOffline = kind_ == 2 || kind_ == 4;
        style.undoPercent = undoes(seed_) ? 1 + unsigned(seed_ % 10) : 0;
        style.checksPrediction = random_.chance(20) && style.awayPerMille == 0;
        return style;
    }

    SimServer makeServer(std::uint64_t seed) {
        std::map<LayerId, LayerDoc> files;
        std::uint64_t lastValue = 500'000'000;
        EditScript script(random_, lastValue, style_.namespacePercent > 0);
        for (const LayerId& layer : style_.layers)
            if (layer != style_.newLayer) files[layer] = script.start();
        server::Project::Options options;
        options.name = "simulation";
        options.leastReplay = 500;
        options.snapshotIntervalMs = 0;
        if (unloads(seed)) options.idleLayerBytes = 0;
        options.keepUnusedBlobsMs = std::array{0, 60, 600}[seed_ % 3];
        if (inParts()) {
            options.wholeCommitBytes = 600;
            options.partBytes = 300;
        }
        if (random_.chance(30)) options.recentCommitBytes = 2'000;
        forgetful_ = random_.chance(15);
        if (forgetful_) options.namespaceLogRevisions = 5;
        options.historyDays = 0;
        return {clock_, random_, network_, std::move(files), std::move(options)};
    }

    void begin() {
        const auto count = 2 + random_.below(random_.chance(20) ? 7 : 3);
        for (std::size_t number = 1; number <= count; ++number) addClient();
    }
    SimClient& addClient() {
        clients_.push_back(std::make_unique<SimClient>(clients_.size() + 1, style_, clock_, random_,
                                                       network_, server_));
        clients_.back()->start();
        return *clients_.back();
    }

    // ---- faults

    void planFaults(std::int64_t end) {
        const auto sometime = [&] { return random_.between(0, end); };
        if (random_.chance(40)) clock_.at(sometime(), [this] { addClient(); });
        if (random_.chance(50))
            for (auto count = 1 + random_.below(3); count > 0; --count)
                clock_.at(sometime(), [this] { kill(); });
        if (random_.chance(25)) {
            clock_.at(sometime(), [this] { fillDisk(); });
            clock_.at(sometime(), [this] { emptyDisk(); });
        }
        if (random_.chance(10)) clock_.at(sometime(), [this] { server_.disk.failed = true; });
        if (style_.bigValues)
            for (auto count = random_.below(6); count > 0; --count)
                clock_.at(sometime(), [this] { server_.collect(); });
        if (style_.bigValues) collectAgain();
        if (seed_ % 4 == 1) forgetAgain();
        rollsBack_ = random_.chance(5);
        // A client that joins again with pending work is compared only in the end.
        if (ages_.chance(40))
            for (auto count = 1 + ages_.below(4); count > 0; --count)
                clock_.at(ages_.between(0, end), [this] { server_.boundHistory(); });
        if (ages_.chance(30)) clock_.at(ages_.between(0, end), [this] { fullAtReconnect(); });
        if (!style_.bigValues && histories_.chance(25)) planOtherHistories(end);
        if (changesRights(seed_))
            for (auto count = 2 + rights_.below(20); count > 0; --count)
                clock_.at(rights_.between(0, end), [this] { changeRights(); });
    }

    // AC4, AC6: an administrator changes roles and rules while users edit. Nobody is an
    // administrator here: these may edit what others have locked.
    void changeRights() {
        constexpr std::array kRoles{Role::Viewer, Role::Reviewer, Role::Editor, Role::Editor};
        ++report_.policies;
        if (rights_.chance(30))
            return server_.setRole(rights_.pick(clients_)->user(), rights_.pick(kRoles));
        std::string rules;
        for (auto count = rights_.below(4); count > 0; --count)
            rules += (rules.empty() ? "" : ", ") + textOf(randomRule());
        auto parsed = AccessRules::parse(R"({"format": 1, "rules": [)" + rules + "]}");
        require(parsed.has_value(), "random rules are wrong");
        server_.setRules(std::move(*parsed));
    }
    AccessRule randomRule() {
        AccessRule rule;
        rule.allows = rights_.chance(40);
        if (rights_.chance(60)) rule.users.insert(rights_.pick(clients_)->user().value);
        if (rights_.chance(20)) rule.roles.insert(rights_.chance(50) ? Role::Editor : Role::Viewer);
        if (rights_.chance(30)) rule.layers = {rights_.pick(style_.layers).value};
        if (rights_.chance(30)) rule.kinds.insert(OpinionKind(rights_.below(10)));
        if (rights_.chance(20))
            rule.actions = {rights_.chance(50) ? ProjectAction::Lock : ProjectAction::Save};
        else if (rights_.chance(30))
            rule.paths = {rights_.chance(50) ? "/A/**" : "/*"};
        return rule;
    }

    // ID2: another project, or an older copy of this one, is served at the address for some time.
    void planOtherHistories(std::int64_t end) {
        for (auto count = 1 + histories_.below(2); count > 0; --count) {
            const std::int64_t from = histories_.between(0, end),
                               to = histories_.between(from, end);
            if (histories_.chance(50)) {
                clock_.at(from, [this] { serveOther(); });
                clock_.at(to, [this] { serveOwn(); });
            } else {
                const bool older = histories_.chance(50);
                clock_.at(from, [this, older] {
                    if (!own_) backup_ = server_.disk.copy(older);
                });
                clock_.at(to, [this] { restore(); });
            }
        }
    }
    void serve(SimDisk::History history, std::optional<SimDisk::History>& before) {
        server_.kill();
        before = server_.disk.put(std::move(history));
        ++report_.otherHistories;
        server_.start();
    }
    void serveOther() {
        if (own_) return;
        serve(other_ ? *std::exchange(other_, std::nullopt) : SimDisk::History{}, own_);
    }
    void serveOwn() {
        if (own_) serve(*std::exchange(own_, std::nullopt), other_);
    }
    void restore() {
        if (own_ || !backup_) return;
        std::optional<SimDisk::History> abandoned;
        serve(*std::exchange(backup_, std::nullopt), abandoned);
    }

    // Everybody has unsent work when they come back to a server whose disk is full.
    void fullAtReconnect() {
        const auto awayUs = ages_.between(1'000, kSecondUs);
        const bool reportsSpace = ages_.chance(50);
        server_.kill();
        clock_.in(awayUs, [this, reportsSpace] {
            server_.setSpace(true, reportsSpace);
            restart();
        });
        clock_.in(awayUs + ages_.between(1'000, 2 * kSecondUs), [this] { emptyDisk(); });
        ++report_.restarts;
    }

    void collectAgain() {
        server_.collect();
        clock_.in(kSecondUs / 25, [this] { collectAgain(); });
    }

    void forgetAgain() {
        server_.forgetClients();
        clock_.in(kSecondUs / 15, [this] { forgetAgain(); });
    }

    void kill() {
        if (!server_.isRunning()) return;
        server_.kill();
        ++report_.restarts;
        clock_.in(random_.between(1'000, 500'000), [this] { restart(); });
    }
    void restart() {
        if (server_.isRunning()) return;
        const Revision head = server_.store().head().revision;
        if (rollsBack_ && !own_ && head > 3) server_.disk.rollBack(head - random_.below(4));
        server_.start();
    }
    void fillDisk() { server_.setSpace(true, random_.chance(50)); }
    void emptyDisk() { server_.setSpace(false, true); }

    // ---- the time without faults and edits

    void becomeQuiet() {
        serveOwn();
        emptyDisk();
        if (changesRights(seed_) && rights_.chance(50)) {
            server_.setRules({});
            for (const auto& client : clients_) server_.setRole(client->user(), Role::Editor);
        }
        if (server_.disk.failed) kill();
        if (random_.chance(50)) addClient();
        for (const auto& client : clients_) client->stopEditing(random_.chance(50));
        runUntilQuiet();
        // Nothing is pending, but the end of a preview may still be on its way.
        run(clock_.nowUs() + 2 * kSecondUs);
        runUntilQuiet();
    }
    void run(std::int64_t until) {
        while (clock_.nowUs() < until) require(clock_.step(), "nothing happens any more");
    }
    // Thousands of big values take minutes; without progress, a minute is long enough. Transactions
    // that are refused one after the other are progress, too.
    void runUntilQuiet() {
        std::pair<Revision, std::size_t> newest;
        for (std::int64_t patience = 0; !isQuiet(); run(clock_.nowUs() + kSecondUs / 10)) {
            const std::pair now{server_.store().head().revision, pendingTransactions()};
            if (std::exchange(newest, now) != now || patience == 0)
                patience = clock_.nowUs() + 60 * kSecondUs;
            require(clock_.nowUs() < patience, "it does not become quiet");
        }
    }
    [[nodiscard]] std::size_t pendingTransactions() const {
        std::size_t pending = 0;
        for (const auto& client : clients_) pending += client->session().pendingTransactions();
        return pending;
    }
    [[nodiscard]] bool isQuiet() const {
        return server_.isRunning() && server_.isIdle() &&
               std::all_of(clients_.begin(), clients_.end(),
                           [](const auto& client) { return client->isQuiet(); });
    }

    // ---- rules that must hold in the end

    void check() {
        report_.snapshots = server_.snapshots;
        report_.unloads = server_.project().counters().unloaded;
        report_.compactions = server_.compactions;
        const Revision head = server_.store().head().revision;
        std::map<LayerId, std::string> truth;
        NamespaceEdits::Docs docs;
        const std::vector<LayerId> layers = *server_.store().layers();
        for (const LayerId& layer : layers) {
            const auto stored = server_.store().loadLayer(layer);
            if (!stored) throw SimFailure("the state is broken: " + stored.error().message);
            truth[layer] = (*stored)->dump();
            docs.emplace(layer, **stored);
            (void)usdText(**stored, *server_.disk.blobs);
            require(server_.replay(layer, head).dump() == truth[layer],
                    "the log gives a different " + layer.value + " than the state");
            const LayerDoc* loaded = server_.project().layer(layer);
            require(!loaded || loaded->dump() == truth[layer],
                    "the server has a different " + layer.value + " than its store");
        }
        const auto checkpoints = *server_.store().checkpoints();
        const bool carriesAddresses =
            !forgetful_ && std::ranges::none_of(
                               clients_, [](const auto& client) { return client->hasSentByPath; });
        for (const auto& client : clients_) {
            client->check(truth);
            if (!losesHistory()) client->namespaceEdits().check(docs, carriesAddresses, report_);
            report_.previewedBlobs += client->previewedBlobs;
            report_.undos += client->undos;
            report_.redos += client->redos;
            report_.forbidden += client->forbidden;
            report_.kept += client->keptOfOthers;
            report_.undosChecked += client->undosChecked;
            for (const Checkpoint& made : client->checkpoints)
                require(server_.disk.forgot || std::ranges::count(checkpoints, made) == 1,
                        "a checkpoint is lost");
        }
        checkLog();
        checkReversals();
        checkProjects();
        checkPeeks();
        if (style_.bigValues) server_.checkBlobs();
        report_.collected = server_.collected;
        report_.forgotten = server_.forgotten;
    }

    // Returns how many edits the server has added (M15, M16).
    [[nodiscard]] std::size_t addedTo(const Commit& commit) const {
        for (const auto& client : clients_)
            if (const auto edits = client->editsOf.find(commit.id.sequence);
                client->session().id() == commit.id.client && edits != client->editsOf.end())
                return commit.edits.size() + commit.dropped.size() - edits->second;
        return 0;
    }

    // Checks M9 and M12.
    void checkLog() {
        std::map<ClientId, std::uint64_t> executed;
        std::set<TransactionId> seen;
        std::map<ClientId, std::uint64_t> last;
        std::set<TransactionId> uncertain;  // they were returned to their authors (M14)
        std::set<ClientId> interrupted;     // had to send some transactions again, after later ones
        for (const auto& client : clients_) {
            for (const std::uint64_t sequence : client->uncertain)
                uncertain.insert({client->session().id(), sequence});
            if (client->connections > 1) interrupted.insert(client->session().id());
        }
        // In other runs some transactions overtake others that wait for their big values, or get
        // another number.
        const bool inOrder = !style_.bigValues && !forgetful_ && report_.restarts == 0;
        for (const server::CommitRecord& stored : server_.disk.commits()) {
            const Commit commit =
                *server::decodeCommit({stored.revision, stored.frame, stored.hash});
            if (server::isInParts(*stored.frame)) ++report_.inParts;
            ++report_.commits;
            checkLocks(commit);
            if (commit.id.sequence == 0) continue;  // an import or a reload
            require(seen.insert(commit.id).second,
                    "transaction " + std::to_string(commit.id.sequence) + " of " +
                        commit.id.client.value +
                        " was committed twice, the second time as commit " +
                        std::to_string(commit.revision));
            if (inOrder && !interrupted.contains(commit.id.client))
                require(
                    commit.id.sequence > std::exchange(last[commit.id.client], commit.id.sequence),
                    "transactions of " + commit.id.client.value +
                        " are out of order: " + std::to_string(commit.id.sequence) +
                        " in revision " + std::to_string(commit.revision));
            if (commit.gesture == 0 && !uncertain.contains(commit.id))
                executed[commit.id.client] += std::size_t(std::count_if(
                    commit.edits.begin(), commit.edits.end() - std::ptrdiff_t(addedTo(commit)),
                    [](const Edit& edit) { return !concernsPlace(edit.action); }));
        }
        for (const auto& client : clients_) {
            report_.lost += client->lostEdits;
            report_.accepted += client->commitsAccepted;
            report_.together += client->commitsTogether;
            report_.writtenAgain += client->session().writtenAgain();
            const std::uint64_t known = executed[client->session().id()] + client->lostEdits +
                                        client->session().writtenAgain();
            // Uncertain edits may have been dropped or not.
            const bool isKnown = known <= client->authoredEdits &&
                                 client->authoredEdits <= known + client->uncertainEdits;
            if (losesHistory() || isKnown) continue;
            throw SimFailure(client->session().id().value + " authored " +
                             std::to_string(client->authoredEdits) + " edits, of which " +
                             std::to_string(executed[client->session().id()]) +
                             " are in the log and " + std::to_string(client->lostEdits) +
                             " were said to be lost, " + std::to_string(client->uncertainEdits) +
                             " perhaps");
        }
    }

    // The work of one client, or of all, goes back. The newest writes of others stay.
    void checkReversals() {
        const auto chosen = random_.below(clients_.size() + 1);
        const ClientId* one =
            chosen < clients_.size() ? &clients_[chosen]->session().id() : nullptr;
        const auto isChosen = [&](const Commit& commit) {
            return one ? commit.id.client == *one : commit.id.sequence > 0;
        };
        LayerDocs before;
        const std::vector<LayerId> layers = *server_.store().layers();
        for (const LayerId& layer : layers) before[layer];
        client::Reversal reversal(before);
        UndoCheck others;
        for (const server::CommitRecord& stored : server_.disk.commits()) {
            const Commit commit =
                *server::decodeCommit({stored.revision, stored.frame, stored.hash});
            const bool isOurs = isChosen(commit);
            const auto added = reversal.add(commit, [&](const Edit&) { return isOurs; });
            require(added.has_value(), "the log cannot be reverted");
            others.committed(commit, isOurs);
        }
        const LayerDocs present = reversal.layers();
        const auto taken = reversal.takeBack();
        LayerDocs after = present;
        for (const auto& edit : taken.edits)
            require(after.at(edit.layer)
                        .apply(edit.path, edit.action, LayerDoc::By::Author)
                        .has_value(),
                    "an edit of a revert is refused");
        const std::string changed = others.changed(present, after, taken.edits);
        require(changed.empty(), "a revert changes " + changed);
        report_.reverted += taken.edits.size();
        report_.stayed += taken.kept.size();
    }

    // ID3: no transaction is in another project than the one for which it was made.
    void checkProjects() {
        const auto check = [&](const StoreId& store, const auto& commits) {
            std::map<TransactionId, Revision> found;
            for (const server::CommitRecord& one : commits) found[one.id] = one.revision;
            for (const auto& client : clients_)
                for (const auto& [sequence, madeFor] : client->madeFor)
                    require(madeFor == store || !found.contains({client->session().id(), sequence}),
                            client->session().id().value + " made transaction " +
                                std::to_string(sequence) + " for another project");
        };
        check(server_.store().identity(), server_.disk.commits());
        if (other_)
            check(server::createMemoryCommitStore(other_->disk)->identity(), other_->commits);
        for (const auto& client : clients_) {
            report_.joinsOfOther += client->joinsOfOther;
            report_.regained += client->regained;
        }
    }

    /// LK1, LK5: checks that nobody edited what somebody else had locked before.
    void checkLocks(const Commit& commit) {
        for (const Edit& edit : commit.edits) {
            const LayerDoc& doc = locked_[edit.layer];
            const LayerLock lock = lockOf(doc);
            require(commit.imported || !lock.locked || lock.holder == commit.user,
                    commit.user.value + " has edited a layer that " + lock.holder.value +
                        " has locked, in revision " + std::to_string(commit.revision));
            if (std::holds_alternative<CreateSpec>(edit.action)) continue;
            const SpecLocks locks = specLocksOf(doc);
            const auto spec = locks.find(withoutVariants(edit.address.path));
            require(commit.imported || spec == locks.end() || spec->second == commit.user ||
                        isSpecifier(edit.action),
                    commit.user.value + " has edited a spec that is locked, in revision " +
                        std::to_string(commit.revision));
        }
        NamespaceLog log;
        for (const Edit& edit : commit.edits) locked_[edit.layer];
        require(applyCommit(locked_, log, commit).has_value(), "a stored commit does not apply");
    }
    static bool isSpecifier(const EditAction& action) {
        const auto* set = std::get_if<SetField>(&action);
        return set && set->field == "specifier";
    }

    void checkPeeks() {
        if (losesHistory()) return;
        for (const auto& client : clients_)
            for (const SimClient::Peeked& peeked : client->peeked)
                require(server_.replay(peeked.layer, peeked.revision).dump() == peeked.dump,
                        "a peek at revision " + std::to_string(peeked.revision) +
                            " shows a different " + peeked.layer.value);
    }

    const std::uint64_t seed_;
    SimRandom random_;
    SimRandom ages_;  // decides when old commits are replaced; separate, so that it does not change
                      // the rest
    SimRandom histories_;  // decides about other histories; separate for the same reason
    SimRandom rights_;     // decides what users may do; the same
    SimClock clock_;
    SimNetwork network_{clock_, random_};
    const std::uint64_t kind_;
    [[nodiscard]] bool inParts() const { return kind_ == 1 || kind_ == 2; }
    const SimStyle style_;
    bool forgetful_ = false;  // the server carries addresses over few revisions only
    SimServer server_;
    std::vector<std::unique_ptr<SimClient>> clients_;
    bool rollsBack_ = false;
    // Set while another project is served; otherwise other_ is the history of that project.
    std::optional<SimDisk::History> own_, other_, backup_;
    /// Commits that were acknowledged may be in no log.
    [[nodiscard]] bool losesHistory() const { return rollsBack_ || report_.otherHistories > 0; }
    LayerDocs locked_;  // at the commit that is being checked
    SimReport report_;
};

}  // namespace

SimReport play(std::uint64_t seed) {
    const auto world = std::make_unique<World>(seed);
    try {
        return world->play();
    } catch (const std::exception& fault) {
        return {.failure = std::string(fault.what()) + "\n" + world->describe()};
    }
}

}  // namespace usdlive::simulation
