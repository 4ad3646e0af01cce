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

#include "usdlive/common/core/Result.h"
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/dds/Segment.h"
#include "usdlive/common/dds/usdlive.h"  // generated from common/protocol/usdlive.idl

// DDS's own headers come with this one: for the sources of the two transports only.
namespace usdlive::dds {

using ProjectSample = usdlive_dds_Project;
using CommitSample = usdlive_dds_Commit;
using SubmitSample = usdlive_dds_Submit;
using ReplySample = usdlive_dds_Reply;
using BesideSample = usdlive_dds_Beside;
using LayerStateSample = usdlive_dds_LayerState;
using PresenceSample = usdlive_dds_Presence;

/// What a writer keeps for readers that are behind. More than a stream has on its way.
inline constexpr std::int32_t kStreamDepth = 512;
inline constexpr std::int32_t kCommitDepth = 1024;
static_assert(kStreamDepth > std::int32_t(kWindowSegments));

/// Version of these topics and of the rules DD1 and on, as Project and Submit say it.
inline constexpr std::uint8_t kDdsProtocol = 1;

/// Bits of `flags`.
inline constexpr std::uint8_t kMore = 1, kEnd = 2, kHold = 4, kAnswer = 8;

/// The partitions of a server's topics (DD2): for all its clients, and for one of them.
[[nodiscard]] std::string partitionOf(std::uint64_t server);
[[nodiscard]] std::string partitionOf(std::uint64_t server, std::uint64_t client);
/// For names of servers, clients and connections.
[[nodiscard]] std::uint64_t randomNumber();

/// Owns a dds_entity_t and all below it.
class Entity {
public:
    Entity() = default;
    /// Throws when Cyclone could not make it: it only fails for want of memory, or for a bug.
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
    Alive,  // a state that ends with its writer, which is missed soon
    State,  // the latest, also for who comes later
    Brief,  // the latest, for a while
    Commits,
    Stream
};
/// Its samples tell of something that can go; the others are messages.
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

/// Untyped halves of Writer and Reader: the QoS of a kind of topic is set here alone.
[[nodiscard]] Entity createWriter(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                                  const char* topic, TopicKind kind, const std::string& partition,
                                  Entity& publisher);
[[nodiscard]] Entity createReader(const Domain& domain, const dds_topic_descriptor_t* descriptor,
                                  const char* topic, TopicKind kind, const std::string& partition,
                                  Entity& subscriber);

/// The GUID of a participant; zeros: it had gone before it was asked for.
using ParticipantId = std::array<std::uint8_t, 16>;
[[nodiscard]] std::string textOf(const ParticipantId& participant);

/// Where a sample comes from, and what it is worth.
struct SampleInfo {
    bool alive = true;  ///< else only the key is there: the instance, or its writer, has gone
    ParticipantId participant;  ///< of the writer

    /// Of what has gone the writer may be forgotten, too.
    [[nodiscard]] bool isOf(const ParticipantId& expected) const {
        return participant == expected || (!alive && participant == ParticipantId{});
    }
};

/// The participants of the writers that a reader hears. One thread.
class Origins {
public:
    [[nodiscard]] const ParticipantId& of(dds_entity_t reader, dds_instance_handle_t writer);

private:
    // Writers that have gone are forgotten with all the others when there are too many.
    static constexpr std::size_t kMostWriters = 4'096;
    std::map<dds_instance_handle_t, ParticipantId> known_;
};

/// Writes samples into a partition ("" is the default one).
template <class Sample>
class Writer {
public:
    Writer() = default;
    Writer(const Domain& domain, const std::string& partition)
        : writer_(createWriter(domain, TopicOf<Sample>::kDescriptor, TopicOf<Sample>::kName,
                               TopicOf<Sample>::kKind, partition, publisher_)) {}
    /// Never blocks. False: it was not taken, which counts as lost.
    bool write(const Sample& sample) { return dds_write(writer_.get(), &sample) == DDS_RETCODE_OK; }
    /// The instance is gone. Of the sample only the key counts.
    void dispose(const Sample& sample) { dds_dispose(writer_.get(), &sample); }
    /// And nothing more will be said of it.
    void forget(const Sample& sample) { dds_unregister_instance(writer_.get(), &sample); }

private:
    Entity publisher_, writer_;  // the writer goes first
};

template <class Sample>
class Reader {
public:
    Reader() = default;
    Reader(const Domain& domain, const std::string& partition)
        : reader_(createReader(domain, TopicOf<Sample>::kDescriptor, TopicOf<Sample>::kName,
                               TopicOf<Sample>::kKind, partition, subscriber_)) {}
    [[nodiscard]] dds_entity_t get() const { return reader_.get(); }

    /// Tells `each(const Sample&, const SampleInfo&)` of what has come. Messages are alive also
    /// when their writer has gone.
    template <class Each>
    void take(Each each) {
        constexpr std::uint32_t kAtOnce = 64;
        for (;;) {
            void* samples[kAtOnce] = {};
            dds_sample_info_t infos[kAtOnce];
            const auto count = dds_take(reader_.get(), samples, infos, kAtOnce, kAtOnce);
            if (count <= 0) return;
            for (std::int32_t index = 0; index < count; ++index) {
                const auto& sample = *static_cast<const Sample*>(samples[index]);
                const bool gone = hasInstances(TopicOf<Sample>::kKind) &&
                                  infos[index].instance_state != DDS_ALIVE_INSTANCE_STATE;
                if (gone || infos[index].valid_data)
                    each(sample, SampleInfo{!gone, origins_.of(reader_.get(),
                                                               infos[index].publication_handle)});
            }
            dds_return_loan(reader_.get(), samples, count);
        }
    }

private:
    Entity subscriber_, reader_;
    Origins origins_;
};

/// Waits for readers, or for somebody who wakes it.
class WaitSet {
public:
    explicit WaitSet(const Domain& domain);
    /// Until the reader is deleted.
    void attach(dds_entity_t reader);
    /// Until a reader has something, or wake() was called, or the time is over.
    void wait(std::chrono::nanoseconds time);
    /// Any thread.
    void wake();

private:
    Entity waitSet_, guard_;
};

// --- Segments as samples

/// A view of the bytes, valid as long as they are; for samples that are written.
[[nodiscard]] dds_sequence_octet octets(ByteView bytes);
[[nodiscard]] SharedBytes copyOf(const dds_sequence_octet& octets);

}  // namespace usdlive::dds
