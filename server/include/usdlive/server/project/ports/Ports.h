// All ports of a project.
#pragma once

#include "usdlive/server/project/ports/Activity.h"
#include "usdlive/server/project/ports/Blobs.h"
#include "usdlive/server/project/ports/Clock.h"
#include "usdlive/server/project/ports/Files.h"
#include "usdlive/server/project/ports/History.h"
#include "usdlive/server/project/ports/Outbox.h"

namespace usdlive::server {

/// What a project needs of the process around it. Calls come from the project's strand and return
/// at once, without waiting for a disk or a network; answers come back as calls of Project on the
/// same strand. The server's app implements them with threads and sockets, the simulation with a
/// queue and a seed. All outlive the project.
struct Ports {
    ports::Outbox& outbox;
    ports::History& history;
    ports::Blobs& blobs;
    ports::Files& files;
    ports::Clock& clock;
    ports::Activity& activity;
};

/// One object that is all of them.
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
