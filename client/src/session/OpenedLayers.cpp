// Joins and leaves layers.
#include "session/OpenedLayers.h"

#include <algorithm>

#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::client {

namespace {

constexpr std::int64_t kAskAgainMs = 1000;
constexpr std::size_t kJoinsAtOnce = 1'000;

// Removes layers from the end of the list, as many as fit into a control message of a client.
std::vector<LayerId> takeSome(std::vector<LayerId>& layers) {
    constexpr std::size_t kMostBytes = 1024 * 1024, kMost = 100'000;
    std::vector<LayerId> some;
    for (std::size_t bytes = 0; !layers.empty() && bytes < kMostBytes && some.size() < kMost;) {
        some.push_back(std::move(layers.back()));
        layers.pop_back();
        bytes += some.back().value.size();
    }
    return some;
}

}  // namespace

bool OpenedLayers::open(const LayerId& layer) {
    const auto [entry, added] = layers_.try_emplace(layer);
    OpenedLayer& opened = entry->second;
    if (!added) {
        const bool isBack = !opened.wanted && !opened.joining;
        opened.wanted = true;
        closed_.erase(layer);
        return isBack;
    }
    opened.joining.emplace();
    if (channel_.isOnline()) join(layer);
    return false;
}

void OpenedLayers::close(const LayerId& layer) {
    const auto entry = layers_.find(layer);
    if (entry == layers_.end()) return;
    entry->second.wanted = false;
    closed_.insert(layer);
}

bool OpenedLayers::isWanted(const LayerId& layer) const {
    const auto entry = layers_.find(layer);
    return entry != layers_.end() && entry->second.wanted;
}

bool OpenedLayers::isJoined(const LayerId& layer) const {
    const auto entry = layers_.find(layer);
    return entry != layers_.end() && entry->second.wanted && !entry->second.joining;
}

bool OpenedLayers::areJoiningAgain() const {
    return std::ranges::any_of(layers_, [](const auto& entry) {
        return entry.second.joining && entry.second.joining->again;
    });
}

// ---- a connection

void OpenedLayers::restart() {
    for (auto& [layer, opened] : layers_)
        if (opened.joining) opened.restart();
    joins_.clear();
    toJoin_.clear();
    askAgainAt_.clear();
}

std::vector<LayerId> OpenedLayers::forHello() {
    toKeep_.clear();
    forEachJoined([this](const LayerId& layer) { toKeep_.push_back(layer); });
    return takeSome(toKeep_);
}

// A server that does not know the message would end the session: it gets these as layers that are
// opened again.
void OpenedLayers::welcomed(const Welcome& message) {
    const bool knows = channel_.knows(kLayerListFeature);
    while (message.resumed && knows && !toKeep_.empty())
        channel_.send(KeepLayers{takeSome(toKeep_)});
    if (message.resumed)
        for (const LayerId& layer : toKeep_)
            if (const auto opened = layers_.find(layer); opened != layers_.end())
                opened->second.restart();
    toKeep_.clear();
    joinAll();
}

void OpenedLayers::askAgain(std::int64_t nowMs) {
    for (auto entry = askAgainAt_.begin(); entry != askAgainAt_.end();) {
        auto& [layer, at] = *entry;
        if (!at) at = nowMs + kAskAgainMs;
        const bool isDue = *at <= nowMs;
        if (isDue) toJoin_.push_back(layer);
        entry = isDue ? askAgainAt_.erase(entry) : std::next(entry);
    }
    sendJoins();
}

void OpenedLayers::restartAll() {
    for (auto& [layer, opened] : layers_) opened.restart();
    restart();
}

void OpenedLayers::joinAll() {
    for (auto& [layer, opened] : layers_)
        if (opened.joining) join(layer);
}

// ---- requests

JoiningLayer* OpenedLayers::joiningOf(const LayerId& layer) {
    const auto opened = layers_.find(layer);
    return opened != layers_.end() && opened->second.joining ? &*opened->second.joining : nullptr;
}

JoiningLayer* OpenedLayers::joiningOf(std::uint64_t request) {
    const auto join = joins_.find(request);
    return join == joins_.end() ? nullptr : joiningOf(join->second);
}

void OpenedLayers::join(const LayerId& layer) {
    toJoin_.push_back(layer);
    sendJoins();
}

// A server keeps requests until they are answered, so it does not get those of all layers at once.
void OpenedLayers::sendJoins() {
    while (!toJoin_.empty() && joins_.size() < kJoinsAtOnce) {
        const OpenLayer open{requests_.nextNumber(), std::move(toJoin_.front()), 0};
        toJoin_.pop_front();
        JoiningLayer* joining = joiningOf(open.layer);
        if (!joining || joining->snapshot.request != 0) continue;
        joining->snapshot = {open.request, {}, {}};
        joins_.emplace(open.request, open.layer);
        requests_.add(open, [this, open](const auto& outcome) {
            if (!outcome) joinFailed(open, outcome.error());
        });
        channel_.send(open);
    }
}

void OpenedLayers::joinFailed(const OpenLayer& open, const ErrorMessage& message) {
    if (joins_.erase(open.request) == 0) return;  // requested again, or closed
    const auto entry = layers_.find(open.layer);
    const Error error = toError(message);
    if (entry->second.joining->again && errorPasses(error.code)) {
        // Own work may wait for this layer.
        entry->second.restart();
        askAgainAt_[open.layer].reset();
        events_.push(event::ServerError{message});
    } else {
        if (entry->second.wanted) events_.push(event::JoinFailed{open.layer, error});
        failed_(open.layer);
        closed_.erase(open.layer);
        layers_.erase(entry);
    }
    sendJoins();
}

// ---- content

void OpenedLayers::received(const LayerOpened& message) {
    if (JoiningLayer* joining = joiningOf(message.request)) joining->snapshot.opened = message;
}

bool OpenedLayers::received(ReceivedSnapshot& received) {
    JoiningLayer* joining = joiningOf(received.request);
    if (!joining) return false;
    const LayerId& layer = joins_.at(received.request);
    Incoming& snapshot = joining->snapshot;
    snapshot.content = std::move(received.whole);
    if (closed_.contains(layer)) return true;
    editor_.arriving(layer, std::move(received.part));
    events_.push(event::Joining{{layer, received.specs, snapshot.specs()}});
    return true;
}

void OpenedLayers::received(const Commit& commit) {
    for (const Edit& edit : commit.edits)
        if (JoiningLayer* joining = joiningOf(edit.layer))
            joining->later.emplace_back(commit.revision, edit);
}

bool OpenedLayers::complete(
    Revision revision, const std::function<void(const LayerId&, const LayerDoc&)>& arrived,
    const std::function<void(const LayerId&, LayerDoc content, bool again)>& joined) {
    std::vector<LayerId> whole;
    for (const auto& [request, layer] : joins_) {
        const Incoming& snapshot = joiningOf(layer)->snapshot;
        if (snapshot.isComplete() && snapshot.opened->revision <= revision) whole.push_back(layer);
    }
    bool any = false;
    for (const LayerId& layer : whole) {
        auto content = contentOf(layer, arrived);
        if (!content) {  // it does not fit to its commits
            layers_.at(layer).restart();
            toJoin_.push_back(layer);
            continue;
        }
        const bool again = std::exchange(layers_.at(layer).joining, std::nullopt)->again;
        joined(layer, *std::move(content), again);
        any = true;
    }
    if (!whole.empty()) sendJoins();
    return any;
}

// Returns the content with the commits since its snapshot; nothing if they do not fit.
std::optional<LayerDoc> OpenedLayers::contentOf(
    const LayerId& layer, const std::function<void(const LayerId&, const LayerDoc&)>& arrived) {
    OpenedLayer& opened = layers_.at(layer);
    Incoming& snapshot = opened.joining->snapshot;
    requests_.forget(snapshot.request);
    joins_.erase(snapshot.request);
    LayerDoc doc = *std::exchange(snapshot.content, std::nullopt);
    if (opened.wanted) arrived(layer, doc);
    for (const auto& [revision, edit] : opened.joining->later)
        if (revision > snapshot.opened->revision && !doc.apply(edit.address.path, edit.action))
            return std::nullopt;
    return doc;
}

void OpenedLayers::dropClosed(const std::function<bool(const LayerId&)>& hasOwnWork,
                              const std::function<void(const LayerId&)>& dropped) {
    for (auto entry = closed_.begin(); entry != closed_.end();) {
        const LayerId& layer = *entry;
        if (hasOwnWork(layer)) {
            ++entry;
            continue;
        }
        const JoiningLayer* joining = joiningOf(layer);
        const bool asked = !joining || joining->snapshot.request != 0;
        if (channel_.isOnline() && asked) channel_.send(CloseLayer{layer});
        if (joining) {
            requests_.forget(joining->snapshot.request);
            joins_.erase(joining->snapshot.request);
        }
        dropped(layer);
        layers_.erase(layer);
        entry = closed_.erase(entry);
    }
}

}  // namespace usdlive::client
