// All ports of a project: the interfaces of the process around it.
#pragma once

#include "project/ports/Activity.h"
#include "project/ports/Blobs.h"
#include "project/ports/Clock.h"
#include "project/ports/Files.h"
#include "project/ports/History.h"
#include "project/ports/Outbox.h"

namespace usdlive::server {

/// The interfaces that a project needs from the process around it.
///
/// The project calls them on its strand. They return at once, without waiting for a disk or a
/// network, and answer by calling a function of Project on the same strand, never from inside the
/// call. A request whose session has closed may be answered or not; every other request must be
/// answered. The server's app implements the ports with threads and sockets, the simulation with a
/// queue and a seed. The implementations outlive the project.
struct Ports {
    ports::Outbox& outbox;
    ports::History& history;
    ports::Blobs& blobs;
    ports::Files& files;
    ports::Clock& clock;
    ports::Activity& activity;
};

/// A base class for one object that implements all ports.
class AllPorts : public ports::Outbox,
                 public ports::History,
                 public ports::Blobs,
                 public ports::Files,
                 public ports::Clock,
                 public ports::Activity {
public:
    [[nodiscard]] Ports ports() { return {*this, *this, *this, *this, *this, *this}; }
};

}  // namespace usdlive::server
