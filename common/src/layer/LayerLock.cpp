// Reads and edits the lock of a layer in its custom layer data (LK1).
#include "usdlive/common/layer/LayerLock.h"

#include <array>
#include <cstring>

#include "OmniLayer.h"

namespace usdlive {

namespace {

using omniLayer::kGroup, omniLayer::keyEdit, omniLayer::valueAt;

const std::string kLocked = "locked", kHolder = "locked_by", kTime = "locked_at";

}  // namespace

LayerLock lockOf(const LayerDoc& doc) {
    LayerLock lock;
    const Dictionary* group = omniLayer::groupOf(doc);
    if (!group) return lock;
    const Value* locked = valueAt(*group, kLocked);
    lock.locked = locked && *locked == boolValue(true);
    if (!lock.locked) return lock;
    if (const Value* holder = valueAt(*group, kHolder))
        lock.holder.value = textOf(*holder).value_or("");
    double seconds = 0;
    const Value* time = valueAt(*group, kTime);
    if (time && time->type() == ValueType::Double && time->bytes().size() == sizeof seconds) {
        std::memcpy(&seconds, time->bytes().data(), sizeof seconds);
        if (seconds > 0 && seconds < 1e11) lock.atMs = std::int64_t(seconds * 1000);
    }
    return lock;
}

std::vector<EditAction> lockEdits(const LayerLock& lock) {
    if (!lock.locked)
        return {keyEdit({kLocked}, boolValue(false)), keyEdit({kHolder}, {}), keyEdit({kTime}, {})};
    return {keyEdit({kHolder}, stringValue(lock.holder.value)),
            keyEdit({kTime}, doubleValue(double(lock.atMs) / 1000)),
            keyEdit({kLocked}, boolValue(true))};
}

std::vector<EditAction> lockEdits(const LayerDoc& doc, const LayerLock& lock) {
    const LayerLock present = lockOf(doc);
    if (present.locked == lock.locked && present.holder == lock.holder) return {};
    return lockEdits(lock);
}

Result<void> checkLockable(const LayerId& layer, const LayerDoc& doc) {
    const Dictionary* group = omniLayer::groupOf(doc);
    if (!group || !omniLayer::dictionaryAt(*group, kLocked)) return {};
    return fail(ErrorCode::InvalidArgument,
                layer.value +
                    " is the root layer of a stage, in which Kit keeps what is locked: it cannot "
                    "be locked itself");
}

bool isLockEdit(const EditAction& action) {
    const FieldPart* part = omniLayer::editedPart(action);
    const auto* key = part ? std::get_if<DictionaryKey>(part) : nullptr;
    if (!key || key->path.size() != 2 || key->path[0] != kGroup) return false;
    return key->path[1] == kLocked || key->path[1] == kHolder || key->path[1] == kTime;
}

bool touchesLock(const EditAction& action) {
    return omniLayer::touches(action, {kLocked, kHolder, kTime});
}

bool touchesLayerData(const EditAction& action) { return omniLayer::editedPart(action) != nullptr; }

}  // namespace usdlive
