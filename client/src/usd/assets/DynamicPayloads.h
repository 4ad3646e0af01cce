// Keeps ticks from waiting for the data providers of dynamic payloads.
#pragma once

namespace usdlive::client {

/// The functions of the plug-in `usdliveEdf` (plugins/edf) for a library in the same process. The
/// plug-in and the library are built separately, so functions are found by name.
struct DynamicPayloadFunctions;

/// Keeps every composition of this process from waiting for the data provider of a payload:
/// a payload that is not here yet is empty, and a thread asks its provider. Nothing happens without
/// the plug-in.
class DynamicPayloadTick {
public:
    DynamicPayloadTick();
    ~DynamicPayloadTick();
    DynamicPayloadTick(const DynamicPayloadTick&) = delete;
    DynamicPayloadTick& operator=(const DynamicPayloadTick&) = delete;

    /// Lets stages compose the payloads that have arrived since a tick of this thread needed them.
    /// Call it outside of change blocks.
    void composeArrived() const;

private:
    const DynamicPayloadFunctions* functions_;  // nullptr: there is no such plug-in
};

}  // namespace usdlive::client
