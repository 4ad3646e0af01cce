// Converts layer states and presences to DDS samples and back.
#include "usdlive/common/dds/StateSamples.h"

#include <cmath>
#include <cstdio>
#include <cstring>

#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/UserColour.h"

namespace usdlive::dds {

namespace {

// The limits are those of control messages.
constexpr std::size_t kMaxName = 256, kMaxText = 64 * 1024, kMaxTexts = 64 * 1024;
constexpr std::size_t kMatrix = 16;

// DDS does not change a sample that it writes.
char* out(const std::string& text) { return const_cast<char*>(text.c_str()); }

template <class Texts>
std::vector<char*> pointersTo(const Texts& texts) {
    std::vector<char*> pointers;
    for (const auto& text : texts) {
        if constexpr (requires { text.value; })
            pointers.push_back(out(text.value));
        else
            pointers.push_back(out(text));
    }
    return pointers;
}

dds_sequence_string sequenceOf(std::vector<char*>& pointers) {
    const auto size = std::uint32_t(pointers.size());
    return {size, size, pointers.data(), false};
}

std::string hexOf(const std::array<float, 3>& colour) {
    const auto part = [](float value) { return unsigned(std::lround(value * 255)); };
    char text[8];
    std::snprintf(text, sizeof text, "#%02x%02x%02x", part(colour[0]) & 0xFF,
                  part(colour[1]) & 0xFF, part(colour[2]) & 0xFF);
    return text;
}

/// Reads texts and notes whether one is too long.
class TextReader {
public:
    std::string operator()(const char* text, std::size_t most) {
        const std::size_t size = text ? ::strnlen(text, most + 1) : 0;
        if (size > most) isGood = false;
        return isGood ? std::string(text ? text : "", size) : std::string();
    }
    std::vector<std::string> operator()(const dds_sequence_string& texts, std::size_t most) {
        std::vector<std::string> read;
        if (texts._length > kMaxTexts) isGood = false;
        for (std::uint32_t index = 0; isGood && index < texts._length; ++index)
            read.push_back((*this)(texts._buffer[index], most));
        return read;
    }
    bool isGood = true;
};

}  // namespace

LayerStateOut::LayerStateOut(const LayerState& state) : editors_(pointersTo(state.editors)) {
    sample.layer = out(state.layer.value);
    sample.revision = state.revision;
    sample.savedRevision = state.saved;
    sample.dirty = state.dirty;
    sample.outdated = state.outdated;
    sample.globallyMuted = state.globallyMuted;
    sample.writableOnDisk = state.writable;
    sample.owner = out(state.owner);
    sample.locked = state.locked;
    sample.holder = out(state.holder.value);
    sample.lockedAtMs = state.lockedAtMs;
    sample.editors = sequenceOf(editors_);
}

std::optional<LayerState> layerStateOf(const LayerStateSample& sample) {
    TextReader text;
    LayerState state;
    auto layer = parseLayerId(sample.layer ? sample.layer : "");
    if (!layer) return std::nullopt;
    state.layer = std::move(*layer);
    state.revision = sample.revision;
    state.saved = sample.savedRevision;
    state.dirty = sample.dirty;
    state.outdated = sample.outdated;
    state.globallyMuted = sample.globallyMuted;
    state.writable = sample.writableOnDisk;
    state.owner = text(sample.owner, kMaxName);
    state.locked = sample.locked;
    state.holder = {text(sample.holder, kMaxName)};
    state.lockedAtMs = sample.lockedAtMs;
    for (std::string& editor : text(sample.editors, kMaxName))
        state.editors.push_back({std::move(editor)});
    return text.isGood ? std::optional(std::move(state)) : std::nullopt;
}

PresenceOut::PresenceOut(const Presence& presence)
    : colour_(hexOf(userColour(presence.user))), selection_(pointersTo(presence.selection)) {
    sample.client = out(presence.client.value);
    sample.user = out(presence.user.value);
    sample.application = out(presence.application);
    sample.colour = out(colour_);
    sample.selection = sequenceOf(selection_);
    const auto numbers = std::uint32_t(presence.camera.size());
    sample.camera = {numbers, numbers, const_cast<double*>(presence.camera.data()), false};
    sample.hasTime = presence.time.has_value();
    sample.time = presence.time.value_or(0);
    sample.editTarget = out(presence.editTarget);
    sample.data = out(presence.data);
}

std::optional<Presence> presenceOf(const PresenceSample& sample) {
    TextReader text;
    Presence presence;
    presence.client = {text(sample.client, kMaxName)};
    presence.user = {text(sample.user, kMaxName)};
    presence.application = text(sample.application, kMaxText);
    presence.selection = text(sample.selection, kMaxText);
    const std::size_t numbers = sample.camera._length;
    if (numbers != 0 && numbers != kMatrix) return std::nullopt;
    presence.camera.assign(sample.camera._buffer, sample.camera._buffer + numbers);
    for (const double number : presence.camera) text.isGood &= std::isfinite(number);
    if (sample.hasTime) presence.time = sample.time;
    text.isGood &= std::isfinite(sample.time);
    presence.editTarget = text(sample.editTarget, kMaxText);
    presence.data = text(sample.data, kMaxText);
    return text.isGood ? std::optional(std::move(presence)) : std::nullopt;
}

}  // namespace usdlive::dds
