// Creates topics, writers and readers of Cyclone DDS with the QoS of each kind.
#include "usdlive/common/dds/Topics.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <random>

#include "usdlive/common/protocol/Control.h"

namespace usdlive::dds {

namespace {

// A server that died is noticed after this time; a client is noticed by its silence.
constexpr dds_duration_t kLiveliness = DDS_SECS(2);
// A sample that is not repeated expires after this time.
constexpr dds_duration_t kLifespan = DDS_MSECS(kPresenceTimeMs);

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

Qos newQos() { return Qos(dds_create_qos(), dds_delete_qos); }

Qos qosOf(TopicKind kind, bool writer) {
    Qos qos = newQos();
    // Writers never wait for readers: a newer sample replaces an unacknowledged one.
    dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
    if (hasInstances(kind)) {
        dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
        dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
        if (kind == TopicKind::Alive)
            dds_qset_liveliness(qos.get(), DDS_LIVELINESS_AUTOMATIC, kLiveliness);
        if (kind != TopicKind::Brief) return qos;
        dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
        dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
        if (writer) dds_qset_lifespan(qos.get(), kLifespan);
        return qos;
    }
    dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
    if (!writer)
        dds_qset_history(qos.get(), DDS_HISTORY_KEEP_ALL, 0);
    else
        dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST,
                         kind == TopicKind::Commits ? kCommitDepth : kStreamDepth);
    return qos;
}

Qos qosOf(const std::vector<std::string>& partitions) {
    Qos qos = newQos();
    std::vector<const char*> names;
    for (const std::string& partition : partitions)
        if (!partition.empty()) names.push_back(partition.c_str());
    if (!names.empty()) dds_qset_partition(qos.get(), std::uint32_t(names.size()), names.data());
    return qos;
}

constexpr std::string_view kAs = "/as/";

/// Returns the user that the only partition of a writer names (DD17).
std::string userOf(const dds_qos_t* qos) {
    std::uint32_t count = 0;
    char** names = nullptr;
    if (!dds_qget_partition(qos, &count, &names)) return {};
    const std::string partition = count == 1 ? names[0] : "";
    for (std::uint32_t index = 0; index < count; ++index) dds_free(names[index]);
    dds_free(names);
    const std::size_t begin = partitionOf(0).size();
    if (partition.size() <= begin || partition.compare(begin, kAs.size(), kAs) != 0) return {};
    const std::string user = partition.substr(begin + kAs.size());
    return partition.find_first_of("*?[") == std::string::npos ? user : "";
}

// Creates a topic. Readers and writers hold references to it.
Entity topicOf(const Domain& domain, const dds_topic_descriptor_t* descriptor, const char* name) {
    return Entity(dds_create_topic(domain.participant(), descriptor, name, nullptr, nullptr));
}

std::string hexOf(std::uint64_t number) {
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(number));
    return text;
}

}  // namespace

std::string partitionOf(std::uint64_t server) { return "usdlive/" + hexOf(server); }
std::string partitionOf(std::uint64_t server, std::uint64_t client) {
    return partitionOf(server) + "/" + hexOf(client);
}

std::string submitPartitionOf(std::uint64_t server, const std::string& user) {
    return user.empty() ? partitionOf(server) : partitionOf(server) + std::string(kAs) + user;
}
std::vector<std::string> submitPartitionsOf(std::uint64_t server) {
    return {partitionOf(server), submitPartitionOf(server, "*")};
}

std::uint64_t randomNumber() {
    std::random_device device;
    return (std::uint64_t(device()) << 32) | device();
}

std::string textOf(const ParticipantId& participant) {
    std::string text;
    for (const std::uint8_t byte : participant) {
        char digits[3];
        std::snprintf(digits, sizeof digits, "%02x", byte);
        text += digits;
    }
    return text;
}

const Origins::Origin& Origins::of(dds_entity_t reader, dds_instance_handle_t writer) {
    const auto found = known_.find(writer);
    if (found != known_.end()) return found->second;
    if (known_.size() >= kMostWriters) known_.clear();
    Origin& origin = known_[writer];
    if (dds_builtintopic_endpoint_t* data = dds_get_matched_publication_data(reader, writer)) {
        std::copy_n(data->participant_key.v, origin.participant.size(), origin.participant.begin());
        if (data->qos) origin.user = userOf(data->qos);
        dds_builtintopic_free_endpoint(data);
    }
    return origin;
}

Entity createWriter(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                    const char* topic, TopicKind kind, const std::string& partition,
                    Entity& publisher) {
    publisher = Entity(dds_create_publisher(
        domain.participant(), qosOf(std::vector<std::string>{partition}).get(), nullptr));
    const Entity shared = topicOf(domain, descriptor, topic);
    return Entity(
        dds_create_writer(publisher.get(), shared.get(), qosOf(kind, true).get(), nullptr));
}

Entity createReader(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                    const char* topic, TopicKind kind, const std::vector<std::string>& partitions,
                    Entity& subscriber) {
    subscriber =
        Entity(dds_create_subscriber(domain.participant(), qosOf(partitions).get(), nullptr));
    const Entity shared = topicOf(domain, descriptor, topic);
    return Entity(
        dds_create_reader(subscriber.get(), shared.get(), qosOf(kind, false).get(), nullptr));
}

WaitSet::WaitSet(const Domain& domain)
    : waitSet_(dds_create_waitset(domain.participant())),
      guard_(dds_create_guardcondition(domain.participant())) {
    dds_waitset_attach(waitSet_.get(), guard_.get(), 0);
}

void WaitSet::attach(dds_entity_t reader) {
    dds_set_status_mask(reader, DDS_DATA_AVAILABLE_STATUS);
    dds_waitset_attach(waitSet_.get(), reader, 0);
}

void WaitSet::wait(std::chrono::nanoseconds time) {
    dds_waitset_wait(waitSet_.get(), nullptr, 0, std::max<dds_duration_t>(time.count(), 0));
    bool ignored = false;
    dds_take_guardcondition(guard_.get(), &ignored);
}

void WaitSet::wake() { dds_set_guardcondition(guard_.get(), true); }

dds_sequence_octet octets(ByteView bytes) {
    // DDS does not change a sample that it writes.
    auto* data = const_cast<std::uint8_t*>(bytes.data());
    const auto size = std::uint32_t(bytes.size());
    return {size, size, data, false};
}

SharedBytes copyOf(const dds_sequence_octet& octets) {
    return std::make_shared<const Bytes>(octets._buffer, octets._buffer + octets._length);
}

}  // namespace usdlive::dds
