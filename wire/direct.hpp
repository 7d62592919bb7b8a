/// The short way for samples that are not kept: one datagram of standard RTPS, made and read here.
///
///     Writer -> encode -> datagram -> ... -> transport -> decode -> Reader's callback
///                                               |
///                                               +-> the library: all else
///
/// A best effort, volatile sample of one datagram passes through the library's histories, flow controller, message
/// group, locator selection and receiver for nothing. The library's ends stay: they announce themselves, are matched
/// and checked for their QoS; only the samples go past them, with the writer's identity and numbers of its own. What
/// comes in another shape than ours (fragments, inline QoS, several samples) is left to the library.
#pragma once

#include <fastdds/rtps/common/Guid.h>
#include <netinet/in.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "wire/rtps_message.hpp"

namespace tactus::wire {

/// An encoded sample in a message, its encapsulation first.
struct EncodedSample {
  eprosima::fastrtps::rtps::GUID_t writer;
  std::uint64_t sequence;
  const std::uint8_t* bytes;
  std::uint32_t size;
};
/// Of a message of one sample from a writer of a user's, and of nothing that matters beside it; none for all others,
/// and when its destination is another participant than `own`.
[[nodiscard]] std::optional<EncodedSample> sole_sample(const std::uint8_t* message, std::uint32_t size,
                                                       const eprosima::fastrtps::rtps::GuidPrefix_t& own);

/// What takes the samples of one reader. One call at a time.
class DirectTaker {
 public:
  using Take = std::function<void(const std::uint8_t* bytes, std::uint32_t size)>;
  explicit DirectTaker(Take take) : take_{std::move(take)} {}

  /// After this returns it takes nothing.
  void close();
  /// Drops what is older than the newest; `newest` is that of the sample's writer.
  void take(const EncodedSample& sample, std::uint64_t& newest);
  /// Numbers that were left out between those that came.
  [[nodiscard]] std::uint64_t lost() const;

 private:
  mutable std::mutex mutex_;
  Take take_;  // empty: closed
  std::uint64_t lost_ = 0;
};

/// Of one participant: the socket that its samples leave from, where the readers that it has found listen, who takes
/// what comes. Threads: any.
class DirectPath final : public eprosima::fastdds::dds::DomainParticipantListener {
 public:
  using Guid = eprosima::fastrtps::rtps::GUID_t;

  /// Throws std::system_error.
  DirectPath();
  ~DirectPath() override;
  DirectPath(const DirectPath&) = delete;
  DirectPath& operator=(const DirectPath&) = delete;

  [[nodiscard]] int socket() const noexcept { return socket_; }
  [[nodiscard]] std::vector<sockaddr_in> places_of(const Guid& reader) const;
  /// Grows with each change of places: a reader may be matched before it is known where it listens.
  [[nodiscard]] std::uint64_t changes() const noexcept { return changes_; }

  void on_writer(const Guid& writer, const std::shared_ptr<DirectTaker>& taker);
  void on_writer_lost(const Guid& writer, const std::shared_ptr<DirectTaker>& taker);
  /// Of all writers.
  void forget(const std::shared_ptr<DirectTaker>& taker);

  /// A message came to participant `own`. True when nothing of it is the library's.
  [[nodiscard]] bool on_received(const std::uint8_t* message, std::uint32_t size);
  void set_own(const eprosima::fastrtps::rtps::GuidPrefix_t& own);

  void on_subscriber_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                               eprosima::fastrtps::rtps::ReaderDiscoveryInfo&& found) override;

 private:
  /// From a writer to a reader.
  struct Route {
    std::shared_ptr<DirectTaker> taker;
    std::shared_ptr<std::uint64_t> newest;  // sequence number; the taker's
  };

  int socket_ = -1;
  std::atomic<std::uint64_t> changes_{0};
  mutable std::mutex mutex_;
  eprosima::fastrtps::rtps::GuidPrefix_t own_;
  std::map<Guid, std::vector<sockaddr_in>> places_;  // by reader
  std::map<Guid, std::vector<Route>> routes_;        // by writer
};

/// Sends for one writer. Any thread finds and loses readers, one at a time sends.
class DirectWriter {
 public:
  using Guid = DirectPath::Guid;
  static constexpr std::size_t kHead = 44;         ///< of RTPS, before the encoded sample
  static constexpr std::size_t kMostBytes = 1472;  ///< one Ethernet frame, as qos/probe.xml has it
  static constexpr std::size_t kMostBody = kMostBytes - kHead;

  DirectWriter(const DirectPath& path, const Guid& writer);

  void on_reader(const Guid& reader);
  void on_reader_lost(const Guid& reader);

  /// Where the encoded sample goes, of kMostBody bytes at most.
  [[nodiscard]] char* body() noexcept { return reinterpret_cast<char*>(message_.data()) + kHead; }
  /// Of so many bytes, to every reader. False when there are some and the system takes it for none of them.
  bool send(std::size_t size) noexcept;

 private:
  void collect_places();

  const DirectPath& path_;
  std::uint64_t sequence_ = 0;
  alignas(
      8) std::array<std::uint8_t, kMostBytes + kMostPaddings> message_{};  // and what moves it, see rtps_message.hpp
  std::mutex mutex_;                                                       // for what follows
  std::set<Guid> readers_;
  std::vector<sockaddr_in> places_;  // of all of them, each once
  std::uint64_t changes_ = 0;        // of the path that places_ know
};

}  // namespace tactus::wire
