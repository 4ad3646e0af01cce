// A program that takes part in usdlive's DDS domain and uses only the IDL: it reads what any tool
// may read, and sends samples that no client sends. USDLIVE_DDS_DOMAIN and USDLIVE_DDS_INTERFACE
// work as in the client.
//
//   stranger read SECONDS           prints the states of layers and the presences, one a line
//   stranger flood WHAT SECONDS     sends a kind (see kFloods) as fast as it can
//   stranger send WHAT COUNT        sends samples of a kind (see kOdd) to the discovered server
#include <dds/dds.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iostream>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "transport/Connection.h"  // ddsSettings
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/dds/usdlive.h"

namespace {

using namespace usdlive;
using namespace std::chrono_literals;
using std::chrono::steady_clock;

[[noreturn]] void fail(const std::string& what) {
    std::cerr << "stranger: " << what << std::endl;
    std::exit(1);
}

dds_entity_t checked(dds_entity_t entity) {
    if (entity < 0) fail(dds_strretcode(-entity));
    return entity;
}

/// Reads like any DDS tool: with the requested QoS, and in every partition of usdlive.
dds_entity_t readerOf(dds_entity_t participant, const dds_topic_descriptor_t& type,
                      const char* topic, bool isState, const char* partition) {
    dds_qos_t* qos = dds_create_qos();
    dds_qset_partition1(qos, partition);
    const auto subscriber = checked(dds_create_subscriber(participant, qos, nullptr));
    dds_reset_qos(qos);
    dds_qset_reliability(qos, isState ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                         DDS_SECS(1));
    if (isState) dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    const auto reader = checked(dds_create_reader(
        subscriber, checked(dds_create_topic(participant, &type, topic, nullptr, nullptr)), qos,
        nullptr));
    dds_delete_qos(qos);
    return reader;
}

template <class Sample>
void take(dds_entity_t reader, const std::function<void(const Sample&, bool gone)>& each) {
    void* samples[1] = {};
    dds_sample_info_t info;
    while (dds_take(reader, samples, &info, 1, 1) > 0) {
        each(*static_cast<Sample*>(samples[0]), info.instance_state != DDS_IST_ALIVE);
        dds_return_loan(reader, samples, 1);
    }
}

// ---- Reading

void print(const usdlive_dds_LayerState& state, bool gone) {
    if (gone) {
        std::cout << "layer " << state.layer << " gone" << std::endl;
        return;
    }
    std::cout << "layer " << state.layer << " revision " << state.revision << " saved "
              << state.savedRevision << (state.dirty ? " dirty" : "")
              << (state.outdated ? " outdated" : "") << (state.globallyMuted ? " muted" : "")
              << (state.writableOnDisk ? " writable" : "");
    if (state.locked) std::cout << " locked by " << state.holder << " at " << state.lockedAtMs;
    for (std::uint32_t index = 0; index < state.editors._length; ++index)
        std::cout << " editor " << state.editors._buffer[index];
    std::cout << std::endl;
}

void print(const usdlive_dds_Presence& presence, bool gone) {
    if (gone) {
        std::cout << "person " << presence.client << " gone" << std::endl;
        return;
    }
    std::cout << "person " << presence.client << " " << presence.user << " in "
              << presence.application << " " << presence.colour;
    for (std::uint32_t index = 0; index < presence.selection._length; ++index)
        std::cout << " selects " << presence.selection._buffer[index];
    if (presence.hasTime) std::cout << " at " << presence.time;
    std::cout << std::endl;
}

void read(dds_entity_t participant, double seconds) {
    const auto states =
        readerOf(participant, usdlive_dds_LayerState_desc, "usdlive_LayerState", true, "usdlive/*");
    const auto people =
        readerOf(participant, usdlive_dds_Presence_desc, "usdlive_Presence", false, "usdlive/*");
    const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
    for (; steady_clock::now() < end; std::this_thread::sleep_for(20ms)) {
        take<usdlive_dds_LayerState>(states, [](const auto& s, bool gone) { print(s, gone); });
        take<usdlive_dds_Presence>(people, [](const auto& p, bool gone) { print(p, gone); });
    }
}

// ---- Sending

struct Seen {
    std::uint64_t server = 0;
    std::uint64_t client = 0, connection = 0;  // those of another participant
};

std::string partitionOf(std::uint64_t server) {
    char text[40];
    std::snprintf(text, sizeof text, "usdlive/%016llx", static_cast<unsigned long long>(server));
    return text;
}

template <class Done>
void waitFor(const char* what, Done done) {
    for (const auto end = steady_clock::now() + 20s; !done(); std::this_thread::sleep_for(10ms))
        if (steady_clock::now() > end) fail(std::string("there is no ") + what);
}

Seen lookAround(dds_entity_t participant, bool needsClient) {
    Seen seen;
    const auto projects =
        readerOf(participant, usdlive_dds_Project_desc, "usdlive_Project", true, "");
    waitFor("server", [&] {
        take<usdlive_dds_Project>(projects, [&](const auto& project, bool gone) {
            if (!gone) seen.server = project.server;
        });
        return seen.server != 0;
    });
    if (!needsClient) return seen;
    const auto submits = readerOf(participant, usdlive_dds_Submit_desc, "usdlive_Submit", false,
                                  partitionOf(seen.server).c_str());
    waitFor("client", [&] {
        take<usdlive_dds_Submit>(submits, [&](const auto& submit, bool gone) {
            if (gone) return;
            seen.client = submit.client;
            seen.connection = submit.connection;
        });
        return seen.client != 0;
    });
    dds_delete(submits);
    return seen;
}

using Odd = void (*)(usdlive_dds_Submit&, const Seen&, std::vector<std::uint8_t>&);
const std::map<std::string, Odd> kOdd{
    // A segment of a stream that was never opened.
    {"notGreeted", [](auto& submit, const Seen&, auto&) { submit.number = 1; }},
    // Samples in the name of another client: its stream, its acknowledgements, its end.
    {"otherClient",
     [](auto& submit, const Seen& seen, auto&) {
         submit.client = seen.client;
         submit.connection = seen.connection;
         submit.number = 1'000;
         submit.ackReply = submit.ackBeside = 1'000'000;
         submit.flags = 2;
     }},
    // A newer connection in the name of another client, which would end that client's session.
    {"otherConnection",
     [](auto& submit, const Seen& seen, auto&) {
         submit.client = seen.client;
         submit.connection = seen.connection + 1;
         submit.flags = 8;
     }},
    {"otherProtocol",
     [](auto& submit, const Seen&, auto&) {
         submit.protocol = 99;
         submit.flags = 8;
     }},
    {"malformed", [](auto& submit, const Seen&, auto& frames) {
         submit.flags = 8;
         frames.assign(300 * 1024, 7);
     }}};
// Kinds that are sent as fast as possible.
const std::map<std::string, Odd> kFloods{{"garbage",
                                          [](auto& submit, const Seen&, auto& frames) {
                                              submit.number = 1;
                                              frames.assign(60 * 1024, 7);
                                          }},
                                         // Opens a connection of one client again and again.
                                         {"connections", [](auto& submit, const Seen&, auto&) {
                                              static std::uint64_t connection = 0;
                                              submit.client = 0x57A96E20000;
                                              submit.connection = ++connection;
                                              submit.flags = 8;
                                          }}};

dds_entity_t submitWriter(dds_entity_t participant, const Seen& seen) {
    dds_qos_t* qos = dds_create_qos();
    dds_qset_partition1(qos, partitionOf(seen.server).c_str());
    const auto publisher = checked(dds_create_publisher(participant, qos, nullptr));
    dds_reset_qos(qos);
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(5));
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
    const auto topic = checked(dds_create_topic(participant, &usdlive_dds_Submit_desc,
                                                "usdlive_Submit", nullptr, nullptr));
    const auto writer = checked(dds_create_writer(publisher, topic, qos, nullptr));
    dds_delete_qos(qos);
    waitFor("reader", [&] {
        dds_publication_matched_status_t matched;
        return dds_get_publication_matched_status(writer, &matched) == DDS_RETCODE_OK &&
               matched.current_count > 0;
    });
    return writer;
}

/// Sends for some seconds. Prints the number of samples.
void flood(dds_entity_t participant, const std::string& what, double seconds) {
    const auto kind = kFloods.find(what);
    if (kind == kFloods.end()) fail("unknown kind of flood: " + what);
    const Seen seen = lookAround(participant, false);
    const auto writer = submitWriter(participant, seen);
    const auto end =
        std::chrono::steady_clock::now() + std::chrono::milliseconds(int(seconds * 1000));
    std::uint64_t count = 0;
    for (; std::chrono::steady_clock::now() < end; ++count) {
        usdlive_dds_Submit submit{};
        submit.client = 0x57A96E20000 + count % 1'000;
        submit.connection = 1;
        submit.protocol = 1;
        std::vector<std::uint8_t> frames(64, 0xFF);
        kind->second(submit, seen, frames);
        submit.frames = {std::uint32_t(frames.size()), std::uint32_t(frames.size()), frames.data(),
                         false};
        if (dds_write(writer, &submit) != DDS_RETCODE_OK) fail("a sample was not taken");
    }
    if (dds_wait_for_acks(writer, DDS_SECS(20)) != DDS_RETCODE_OK) fail("nobody has read it");
    std::cout << count << "\n";
}

void send(dds_entity_t participant, const std::string& what, int count) {
    const auto odd = kOdd.find(what);
    if (odd == kOdd.end()) fail("unknown kind of sample: " + what);
    const Seen seen = lookAround(participant, what.starts_with("otherC"));
    const auto writer = submitWriter(participant, seen);
    for (int index = 0; index < count; ++index) {
        usdlive_dds_Submit submit{};
        submit.client = 0x57A96E20000 + std::uint64_t(index % 10);
        submit.connection = 1;
        submit.protocol = 1;
        std::vector<std::uint8_t> frames(64, 0xFF);
        odd->second(submit, seen, frames);
        submit.frames = {std::uint32_t(frames.size()), std::uint32_t(frames.size()), frames.data(),
                         false};
        if (dds_write(writer, &submit) != DDS_RETCODE_OK) fail("a sample was not taken");
    }
    if (dds_wait_for_acks(writer, DDS_SECS(20)) != DDS_RETCODE_OK) fail("nobody has read it");
}

}  // namespace

int main(int argc, char** argv) {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    const auto settings = client::ddsSettings();
    if (!settings) fail(settings.error().message);
    const auto domain = dds::createDomain(*settings);
    if (!domain) fail(domain.error().message);
    if (arguments.size() == 2 && arguments[0] == "read")
        read((*domain)->participant(), std::stod(arguments[1]));
    else if (arguments.size() == 3 && arguments[0] == "send")
        send((*domain)->participant(), arguments[1], std::stoi(arguments[2]));
    else if (arguments.size() == 3 && arguments[0] == "flood")
        flood((*domain)->participant(), arguments[1], std::stod(arguments[2]));
    else
        fail("read SECONDS, send WHAT COUNT, or flood WHAT SECONDS");
    return 0;
}
