// The actions of the model, their results, and the rules that hold in each world.
#include "Model.h"

#include "usdlive/common/protocol/Control.h"

namespace usdlive::model {

namespace {

void require(bool holds, const char* what) {
    if (!holds) throw Violation(what);
}

// Sessions are numbered by client and connection, so that the numbers do not depend on the order in
// which the clients connect.
std::size_t clientOf(std::uint8_t session) { return session % kClients; }
std::uint8_t nextSession(std::uint8_t session, std::size_t client) {
    return std::uint8_t(session == 0 ? kClients + client : session + kClients);
}

const char* nameOf(std::size_t client) { return client == 0 ? "Ada" : "Bob"; }

}  // namespace

Model::Model(const Scenario& scenario)
    : scenario_(scenario),
      clients_{Explored<ModelClient>(
                   [this] { return std::make_unique<ModelClient>(scenario_, 0, messages_); }),
               Explored<ModelClient>(
                   [this] { return std::make_unique<ModelClient>(scenario_, 1, messages_); })},
      server_([this] { return std::make_unique<ModelServer>(scenario_, messages_, archive_); }) {}

World Model::start() {
    World world;
    for (std::size_t client = 0; client < kClients; ++client) setLine(world, client, {});
    while (scenario_.joined) {
        const auto possible = actions(world);
        const auto next = std::find_if(possible.begin(), possible.end(),
                                       [](Action action) { return action.isProgress(); });
        if (next == possible.end()) break;
        world = after(world, *next);
    }
    return world;
}

void Model::setLine(World& world, std::size_t client, Line line) {
    const auto [entry, added] =
        lineNumbers_.try_emplace(std::move(line), std::uint32_t(lines_.size()));
    if (added) lines_.push_back(&entry->first);
    world.lines[client] = entry->second;
}

// ---- possible actions

std::vector<Action> Model::actions(const World& world) {
    std::vector<Action> actions;
    for (std::uint8_t client = 0; client < kClients; ++client) addActionsOf(actions, world, client);
    addActionsOfServer(actions, world);
    // SE21: what was refused is tried again when nothing else happens; otherwise a run could try
    // for ever while the store is opened again.
    if (std::ranges::none_of(actions, &Action::isProgress))
        for (std::uint8_t client = 0; client < kClients; ++client)
            if (clients_[client].summary(world.clients[client]).holds &&
                changes(world, client, Input::Tick))
                actions.push_back({Action::Tick, client, 0});
    return actions;
}

bool Model::changes(const World& world, std::size_t client, Input::Kind kind) {
    const auto& step = clients_[client].step(world.clients[client], {kind});
    return step.next != world.clients[client] || !step.outputs.empty() || !step.fault.empty();
}

void Model::addActionsOf(std::vector<Action>& actions, const World& world, std::uint8_t client) {
    const Line& line = lineOf(world, client);
    const Bounds& most = scenario_.bounds;
    const auto add = [&](Action::Kind kind, std::size_t argument = 0) {
        actions.push_back({kind, client, std::uint16_t(argument)});
    };
    if (!line.toClient.empty()) add(Action::ToClient);
    if (scenario_.flaw == Flaw::Reorders && line.toClient.size() > 1) add(Action::ToClient, 1);
    if (line.state == Line::Up && !line.toServer.empty()) add(Action::ToServer);
    for (std::size_t index = 0; index < line.late.size(); ++index) {
        if (!line.late[index].toServer.empty()) add(Action::ToServerLate, index);
        add(Action::ServerNotices, index);
    }
    if (line.state == Line::Dead) add(Action::ClientNotices);
    if (line.state == Line::Down) add(Action::Connect);
    if (scenario_.ownTicks && changes(world, client, Input::Tick)) add(Action::Tick);
    if (clients_[client].summary(world.clients[client]).written <
            scenario_.scripts[client].size() &&
        changes(world, client, Input::Write))
        add(Action::Write);
    if (world.spent.toggles[client] < most.toggles[client]) add(Action::Toggle);
    if (line.state == Line::Up && world.spent.breaks[client] < most.breaks[client])
        add(Action::Break);
}

void Model::addActionsOfServer(std::vector<Action>& actions, const World& world) const {
    const ModelServer::Summary& server = server_.summary(world.server);
    const Bounds &spent = world.spent, &most = scenario_.bounds;
    const auto add = [&](Action::Kind kind, std::size_t argument = 0) {
        actions.push_back({kind, 0, std::uint16_t(argument)});
    };
    for (std::size_t commits = 1; commits <= server.unsaved; ++commits) add(Action::Flush, commits);
    for (std::size_t job = 0; job < server.jobs; ++job) add(Action::Answer, job);
    if (spent.deaths < most.deaths)
        for (std::size_t written = 0; written <= server.unsaved; ++written)
            add(Action::Die, written);
    if (spent.diskFulls < most.diskFulls && server.unsaved > 0) add(Action::DiskFull);
    if (spent.diskFailures < most.diskFailures && server.unsaved > 0)
        for (std::size_t written = 0; written <= server.unsaved; ++written)
            add(Action::DiskFails, written);
    if (spent.rollBacks < most.rollBacks && server.history->hashes.size() > 2)
        for (std::size_t older = 0; older <= 1; ++older) add(Action::RollBack, older);
}

// ---- results of actions

World Model::after(World world, Action action) {
    act(world, action, lineOf(world, action.client));
    return world;
}

void Model::act(World& world, Action action, Line line) {
    const std::size_t client = action.client;
    const auto take = [](Queue& queue, std::size_t index) {
        const MessageId message = queue[index];
        queue.erase(queue.begin() + std::ptrdiff_t(index));
        return message;
    };
    switch (action.kind) {
        case Action::ToClient: {
            const MessageId message = take(line.toClient, action.argument);
            setLine(world, client, std::move(line));
            return stepClient(world, client, {Input::Receive, 0, message});
        }
        case Action::ToServer: {
            const MessageId message = take(line.toServer, 0);
            const std::uint8_t session = line.session;
            setLine(world, client, std::move(line));
            return stepServer(world, {Input::Receive, session, message});
        }
        case Action::ToServerLate: {
            Late& late = line.late[action.argument];
            const MessageId message = take(late.toServer, 0);
            const std::uint8_t session = late.session;
            setLine(world, client, std::move(line));
            return stepServer(world, {Input::Receive, session, message});
        }
        case Action::ServerNotices: {
            const std::uint8_t session = line.late[action.argument].session;
            line.late.erase(line.late.begin() + action.argument);
            setLine(world, client, std::move(line));
            return stepServer(world, {Input::Disconnect, session});
        }
        case Action::Break:
            ++world.spent.breaks[client];
            line.late.push_back({line.session, std::move(line.toServer)});
            [[fallthrough]];
        case Action::ClientNotices:
            line.state = Line::Down;
            line.toServer.clear();
            line.toClient.clear();
            setLine(world, client, std::move(line));
            return stepClient(world, client, {Input::Disconnect});
        case Action::Connect:
            line.state = Line::Up;
            line.session = nextSession(line.session, client);
            setLine(world, client, line);
            stepServer(world, {Input::Connect, line.session});
            return stepClient(world, client, {Input::Connect});
        case Action::Tick:
            return stepClient(world, client, {Input::Tick});
        case Action::Write:
            return stepClient(world, client, {Input::Write});
        case Action::Toggle:
            ++world.spent.toggles[client];
            return stepClient(world, client, {Input::Toggle});
        case Action::Flush:
            return stepServer(world, {Input::Flush, 0, action.argument});
        case Action::Answer:
            return stepServer(world, {Input::Answer, 0, action.argument});
        case Action::Die:
            ++world.spent.deaths;
            serverDied(world);
            return stepServer(world, {Input::Die, 0, action.argument});
        case Action::RollBack:
            ++world.spent.rollBacks;
            serverDied(world);
            return stepServer(world, {Input::RollBack, 0, action.argument});
        case Action::DiskFull:
            ++world.spent.diskFulls;
            return stepServer(world, {Input::DiskFull});
        case Action::DiskFails:
            ++world.spent.diskFailures;
            return stepServer(world, {Input::DiskFails, 0, action.argument});
    }
}

// Messages that the process had sent may still arrive.
void Model::serverDied(World& world) {
    for (std::size_t client = 0; client < kClients; ++client) {
        Line line = lineOf(world, client);
        if (line.state == Line::Up) line.state = Line::Dead;
        line.toServer.clear();
        line.late.clear();
        setLine(world, client, std::move(line));
    }
}

void Model::stepClient(World& world, std::size_t client, Input input) {
    const auto& step = clients_[client].step(world.clients[client], input);
    if (!step.fault.empty()) throw Violation(std::string(nameOf(client)) + ": " + step.fault);
    world.clients[client] = step.next;
    if (step.outputs.empty()) return;
    Line line = lineOf(world, client);
    require(line.state != Line::Down, "a session sends without a connection");
    for (const Output& output : step.outputs) {
        if (!output.closes) {
            if (line.state == Line::Up) line.toServer.push_back(output.message);
            continue;
        }
        if (line.state == Line::Up)
            line.late.push_back({line.session, std::exchange(line.toServer, {})});
        line.state = Line::Down;
        line.toClient.clear();
    }
    setLine(world, client, std::move(line));
}

void Model::stepServer(World& world, Input input) {
    const auto& step = server_.step(world.server, input);
    if (!step.fault.empty()) throw Violation("server: " + step.fault);
    world.server = step.next;
    if (step.outputs.empty()) return;
    std::array<Line, kClients> lines;
    for (std::size_t client = 0; client < kClients; ++client) lines[client] = lineOf(world, client);
    for (const Output& output : step.outputs) {
        Line& line = lines[clientOf(output.session)];
        if (line.session != output.session || line.state != Line::Up)
            continue;         // the session has ended
        if (output.closes) {  // a late hello of the client over an older connection has arrived
            line.state = Line::Dead;
            line.late.push_back({line.session, std::move(line.toServer)});
            line.toServer.clear();
        } else {
            line.toClient.push_back(output.message);
        }
    }
    for (std::size_t client = 0; client < kClients; ++client)
        setLine(world, client, std::move(lines[client]));
}

// ---- rules that must hold

void Model::check(const World& world, bool quiet) const {
    const ModelServer::Summary& server = server_.summary(world.server);
    for (std::size_t client = 0; client < kClients; ++client) {
        const ModelClient::Summary& summary = clients_[client].summary(world.clients[client]);
        if (!scenario_.losesHistory()) checkClient(summary, *server.history);
        require((summary.authored & ~summary.pending & ~summary.lost & ~summary.acknowledged) == 0,
                "an edit is neither pending nor acknowledged nor reported as lost (M12)");
        if (!quiet) continue;
        require(summary.online, "a client stays offline");
        require(summary.upToDate,
                "work stays pending, or the editor does not show the confirmed layer");
        require(summary.revision + 1 == server.history->hashes.size() &&
                    summary.hash == server.history->hashes.back(),
                "a client does not reach the newest commit");
        require(!summary.wanted ||
                    (summary.joined && summary.confirmed == server.history->contents.back()),
                "a client's layer differs from the server's in the end (M8)");
    }
    if (quiet) require(server.loadedIsStored, "the server's layer differs from its store's");
}

void Model::checkClient(const ModelClient::Summary& client, const History& history) const {
    if (!client.hasHistory) return;
    require(client.revision < history.hashes.size(),
            "a client received a commit that is not durable (M10)");
    require(client.hash == history.hashes[client.revision], "a client has seen another order");
    require(!client.joined || client.confirmed == history.contents[client.revision],
            "a client's confirmed layer differs from the log up to its revision (M8)");
    const Labels answered = client.authored & ~client.pending & ~client.lost;
    require((answered & ~history.committed[client.revision]) == 0,
            "an edit is neither pending nor committed nor reported as lost (M12)");
    require((client.lost & history.committed.back()) == 0,
            "an edit is committed that was reported as lost (M12)");
}

// ---- text for readers

std::string Model::describe(MessageId message) const {
    std::string text;
    const auto frames = splitMessage(*messages_[message]);
    for (const ByteView bytes : *frames) {
        const auto frame = decodeFrame(bytes);
        if (!text.empty()) text += ", ";
        if (const auto* control = std::get_if<ControlFrame>(&*frame))
            text += control->json;
        else if (const auto* submit = std::get_if<SubmitFrame>(&*frame))
            text += "submit " + std::to_string(submit->transaction.id.sequence);
        else if (const auto* commit = std::get_if<CommitFrame>(&*frame))
            text += "commit " + std::to_string(commit->commit.revision) + " (" +
                    commit->commit.id.client.value + " " +
                    std::to_string(commit->commit.id.sequence) + ")";
        else if (const auto* refusal = std::get_if<RefusalFrame>(&*frame))
            text += "refusal of " + std::to_string(refusal->sequence) + ", " +
                    std::string(errorName(refusal->error.code));
        else
            text += "snapshot";
    }
    return text;
}

std::string Model::describe(const World& before, Action action) {
    const std::string who = nameOf(action.client);
    const Line& line = lineOf(before, action.client);
    const std::string number = std::to_string(action.argument);
    switch (action.kind) {
        case Action::ToClient:
            return who + " receives " + describe(line.toClient[action.argument]);
        case Action::ToServer:
            return "the server receives of " + who + " " + describe(line.toServer.front());
        case Action::ToServerLate:
            return "the server receives, late, of " + who + " " +
                   describe(line.late[action.argument].toServer.front());
        case Action::ServerNotices:
            return "the server notices that " + who + " had gone";
        case Action::ClientNotices:
            return who + " notices that the server has gone";
        case Action::Connect:
            return who + " connects";
        case Action::Tick:
            return who + " ticks";
        case Action::Flush:
            return "commits become durable: " + number;
        case Action::Answer:
            return "the server's host does job " + number;
        case Action::Write:
            return who + " writes";
        case Action::Toggle:
            return who + " closes or opens the layer";
        case Action::Break:
            return who + "'s line breaks";
        case Action::Die:
            return "the server dies, with " + number + " commits durable and not reported";
        case Action::DiskFull:
            return "the disk is full";
        case Action::DiskFails:
            return "the disk fails, with " + number + " commits durable and not reported";
        case Action::RollBack:
            return action.argument == 0
                       ? "the server dies, and its disk has lost the newest commit"
                       : "the server dies, and a copy without the newest commit is served with "
                         "the same epoch";
    }
    return {};
}

std::string Model::describe(const World& world) const {
    const ModelServer::Summary& server = server_.summary(world.server);
    std::string text = "server: durable " + std::to_string(server.history->hashes.size() - 1) +
                       ", not yet " + std::to_string(server.unsaved) + ", jobs " +
                       std::to_string(server.jobs) + "\n";
    for (std::size_t client = 0; client < kClients; ++client) {
        const ModelClient::Summary& summary = clients_[client].summary(world.clients[client]);
        char labels[64];
        std::snprintf(labels, sizeof labels, "authored %x, pending %x, lost %x", summary.authored,
                      summary.pending, summary.lost);
        text += std::string(nameOf(client)) + ": " + (summary.online ? "online" : "offline") +
                (summary.joined ? ", joined" : "") + (summary.upToDate ? ", up to date" : "") +
                ", revision " + std::to_string(summary.revision) + ", " + labels + "\n";
    }
    return text;
}

std::size_t Model::compareWays(std::size_t each) {
    std::size_t compared = server_.compareWays(each);
    for (auto& client : clients_) compared += client.compareWays(each);
    return compared;
}

}  // namespace usdlive::model
