// The DDS topics, their writers and their readers.
#pragma once

#include <dds/dds.h>

#include <array>
#include <chrono>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/dds/Segment.h"
#include "usdlive/common/dds/usdlive.h"  // generated from common/protocol/usdlive.idl

// Wraps the topics, writers and readers of Cyclone DDS. Includes its headers, so only the sources
// of the two transports may include this one.
namespace usdlive::dds {

using ProjectSample = usdlive_dds_Project;
using CommitSample = usdlive_dds_Commit;
using SubmitSample = usdlive_dds_Submit;
using ReplySample = usdlive_dds_Reply;
using BesideSample = usdlive_dds_Beside;
using LayerStateSample = usdlive_dds_LayerState;
using PresenceSample = usdlive_dds_Presence;

/// The number of samples that a writer keeps for slow readers; more than the window of a stream.
inline constexpr std::int32_t kStreamDepth = 512;
inline constexpr std::int32_t kCommitDepth = 1024;
static_assert(kStreamDepth > std::int32_t(kWindowSegments));

/// The version of these topics and of the DD rules, as sent in Project and Submit.
inline constexpr std::uint8_t kDdsProtocol = 1;

/// The bits of `flags`.
inline constexpr std::uint8_t kMore = 1, kEnd = 2, kHold = 4, kAnswer = 8;

/// Return the partitions of a server's topics (DD2): for all its clients, and for one of them.
[[nodiscard]] std::string partitionOf(std::uint64_t server);
[[nodiscard]] std::string partitionOf(std::uint64_t server, std::uint64_t client);
/// DD17: returns the partition in which a user writes Submit. Without a user it is the one above.
[[nodiscard]] std::string submitPartitionOf(std::uint64_t server, const std::string& user);
/// Returns the partitions of all users, for the server.
[[nodiscard]] std::vector<std::string> submitPartitionsOf(std::uint64_t server);
/// Returns a random number for the names of servers, clients and connections.
[[nodiscard]] std::uint64_t randomNumber();

/// Owns a dds_entity_t and all entities below it.
class Entity {
public:
    Entity() = default;
    /// Throws if Cyclone DDS could not create the entity, which only lack of memory or a bug can
    /// cause.
    explicit Entity(dds_entity_t handle) : handle_(handle) {
        if (handle < 0) throw std::runtime_error(std::string("DDS: ") + dds_strretcode(-handle));
    }
    Entity(Entity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
    Entity& operator=(Entity&& other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    ~Entity() {
        if (handle_ > 0) dds_delete(handle_);
    }
    [[nodiscard]] dds_entity_t get() const { return handle_; }

private:
    dds_entity_t handle_ = 0;
};

template <class Sample>
struct TopicOf;  // name, descriptor, kind
enum class TopicKind {
    Alive,  // a state that ends with its writer; a lost writer is noticed soon
    State,  // the latest state, also for late readers
    Brief,  // the latest state, for a limited time
    Commits,
    Stream
};
/// Returns true if the samples are states of instances, which can be disposed; false for messages.
constexpr bool hasInstances(TopicKind kind) {
    return kind == TopicKind::Alive || kind == TopicKind::State || kind == TopicKind::Brief;
}

template <>
struct TopicOf<ProjectSample> {
    static constexpr const char* kName = "usdlive_Project";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Project_desc;
    static constexpr TopicKind kKind = TopicKind::Alive;
};
template <>
struct TopicOf<CommitSample> {
    static constexpr const char* kName = "usdlive_Commit";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Commit_desc;
    static constexpr TopicKind kKind = TopicKind::Commits;
};
template <>
struct TopicOf<SubmitSample> {
    static constexpr const char* kName = "usdlive_Submit";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Submit_desc;
    static constexpr TopicKind kKind = TopicKind::Stream;
};
template <>
struct TopicOf<ReplySample> {
    static constexpr const char* kName = "usdlive_Reply";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Reply_desc;
    static constexpr TopicKind kKind = TopicKind::Stream;
};
template <>
struct TopicOf<BesideSample> {
    static constexpr const char* kName = "usdlive_Beside";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Beside_desc;
    static constexpr TopicKind kKind = TopicKind::Stream;
};
template <>
struct TopicOf<LayerStateSample> {
    static constexpr const char* kName = "usdlive_LayerState";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_LayerState_desc;
    static constexpr TopicKind kKind = TopicKind::State;
};
template <>
struct TopicOf<PresenceSample> {
    static constexpr const char* kName = "usdlive_Presence";
    static constexpr const dds_topic_descriptor_t* kDescriptor = &usdlive_dds_Presence_desc;
    static constexpr TopicKind kKind = TopicKind::Brief;
};

/// The untyped parts of Writer and Reader. The QoS of each kind of topic is set only here.
[[nodiscard]] Entity createWriter(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                                  const char* topic, TopicKind kind, const std::string& partition,
                                  Entity& publisher);
[[nodiscard]] Entity createReader(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                                  const char* topic, TopicKind kind,
                                  const std::vector<std::string>& partitions, Entity& subscriber);

/// The GUID of a participant; zeros if it left before it could be looked up.
using ParticipantId = std::array<std::uint8_t, 16>;
[[nodiscard]] std::string textOf(const ParticipantId& participant);

/// The origin of a sample and whether it is alive.
struct SampleInfo {
    bool alive = true;  ///< false: only the key is set; the instance or its writer has ended
    ParticipantId participant;  ///< the participant of the writer
    /// DD17: the user in the partition of the writer; empty: none. With DDS Security it is proved.
    std::string user;

    /// The writer of a disposed instance may be unknown.
    [[nodiscard]] bool isOf(const ParticipantId& expected) const {
        return participant == expected || (!alive && participant == ParticipantId{});
    }
};

/// Caches the participants and users of the writers that a reader receives from. One thread.
class Origins {
public:
    struct Origin {
        ParticipantId participant{};
        std::string user;
    };
    [[nodiscard]] const Origin& of(dds_entity_t reader, dds_instance_handle_t writer);

private:
    // The cache is cleared when it reaches this size, because writers that left stay in it.
    static constexpr std::size_t kMostWriters = 4'096;
    std::map<dds_instance_handle_t, Origin> known_;
};

/// Writes samples into a partition ("" is the default one).
template <class Sample>
class Writer {
public:
    Writer() = default;
    Writer(const Domain& domain, const std::string& partition)
        : writer_(createWriter(domain, TopicOf<Sample>::kDescriptor, TopicOf<Sample>::kName,
                               TopicOf<Sample>::kKind, partition, publisher_)) {}
    /// Never blocks. Returns false if DDS did not accept the sample; treat it as lost.
    bool write(const Sample& sample) { return dds_write(writer_.get(), &sample) == DDS_RETCODE_OK; }
    /// Disposes the instance. Only the key of the sample is used.
    void dispose(const Sample& sample) { dds_dispose(writer_.get(), &sample); }
    /// Unregisters the instance: the writer sends no more samples of it.
    void forget(const Sample& sample) { dds_unregister_instance(writer_.get(), &sample); }

private:
    Entity publisher_, writer_;  // the writer is deleted first
};

template <class Sample>
class Reader {
public:
    Reader() = default;
    Reader(const Domain& domain, const std::string& partition)
        : Reader(domain, std::vector<std::string>{partition}) {}
    /// Reads several partitions. Their names may contain wildcards.
    Reader(const Domain& domain, const std::vector<std::string>& partitions)
        : reader_(createReader(domain, TopicOf<Sample>::kDescriptor, TopicOf<Sample>::kName,
                               TopicOf<Sample>::kKind, partitions, subscriber_)) {}
    [[nodiscard]] dds_entity_t get() const { return reader_.get(); }

    /// Calls `each(const Sample&, const SampleInfo&)` for every received sample. Messages are alive
    /// even if their writer has left.
    template <class Each>
    void take(Each each) {
        while (takeSome(each)) {
        }
    }
    /// The same for at most some tens of samples. Returns false if there was none.
    template <class Each>
    bool takeSome(Each& each) {
        constexpr std::uint32_t kAtOnce = 64;
        void* samples[kAtOnce] = {};
        dds_sample_info_t infos[kAtOnce];
        const auto count = dds_take(reader_.get(), samples, infos, kAtOnce, kAtOnce);
        if (count <= 0) return false;
        for (std::int32_t index = 0; index < count; ++index) {
            const auto& sample = *static_cast<const Sample*>(samples[index]);
            const bool gone = hasInstances(TopicOf<Sample>::kKind) &&
                              infos[index].instance_state != DDS_ALIVE_INSTANCE_STATE;
            if (!gone && !infos[index].valid_data) continue;
            const auto& origin = origins_.of(reader_.get(), infos[index].publication_handle);
            each(sample, SampleInfo{!gone, origin.participant, origin.user});
        }
        dds_return_loan(reader_.get(), samples, count);
        return true;
    }

private:
    Entity subscriber_, reader_;
    Origins origins_;
};

/// Waits until a reader has samples or another thread wakes it.
class WaitSet {
public:
    explicit WaitSet(const Domain& domain);
    /// The reader is detached when it is deleted.
    void attach(dds_entity_t reader);
    /// Returns when a reader has samples, after wake(), or after `time`.
    void wait(std::chrono::nanoseconds time);
    /// May be called from any thread.
    void wake();

private:
    Entity waitSet_, guard_;
};

// --- Segments as samples

/// Returns a view of the bytes for samples that are written. The bytes must outlive it.
[[nodiscard]] dds_sequence_octet octets(ByteView bytes);
[[nodiscard]] SharedBytes copyOf(const dds_sequence_octet& octets);

}  // namespace usdlive::dds
