/// The members of a secured session, and the only class that decides whose messages and samples count.
///
///     announcement       identity = hash in the GUID, not revoked, not expired,
///                        lease < kMaxLease, few unproved ones of its address    -> the library discovers the sender
///     any other message  the sender is recorded and not being removed, its
///                        certificate is not cut off, and it is proved or has announced itself within its
///                        lease; few handshakes, with its own certificate        -> the library reads it
///     sample             its author is the member that it claims, the role of
///                        this member may write the topic, and its keys permit the
///                        users and the object that the sample names               -> the program gets it
///
/// The class records a certificate when the first of its programs announces itself. The library authenticates GUIDs
/// (keys/identity.hpp). A certificate is cut off when it is revoked or has expired, or when kMaxRefused samples of it
/// were refused or invalid within kRefusedWindow. Then all its messages are dropped, so the library removes its
/// participants when their leases end.
///
/// Threads: any. Cost of a message or a sample: two lookups in trees and, for a restricted member, a search of its
/// permitted names, under a lock; of a handshake, also the comparison of a certificate without it.
#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "keys/identity.hpp"
#include "keys/member.hpp"
#include "realtime/inheriting_mutex.hpp"
#include "realtime/process.hpp"
#include "session/messages.hpp"
#include "wire/audit.hpp"
#include "wire/rate_limit.hpp"
#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// The fields of a sample that the keys of its author must permit.
struct Claim {
  std::optional<std::uint64_t> participant;     ///< id of the sender; none: the sample names none
  std::uint64_t user = 0;                       ///< id of the user that it moves or represents; 0: none
  std::uint64_t object = 0;                     ///< id of the object that it offers or moves; 0: none
  const session::RosterEntry* entry = nullptr;  ///< the sample, if it is a roster entry
  /// Name of the sender, if the sample states it.
  const std::string* name = nullptr;
};

class Members {
 public:
  /// Number of refused and invalid samples in kRefusedWindow after which a certificate is cut off.
  static constexpr std::uint32_t kMaxRefused = 100;
  static constexpr std::chrono::seconds kRefusedWindow{60};
  /// Max number of participants that are recorded at a time, three for each program.
  static constexpr std::size_t kMaxParticipants = 4096;
  /// Max number of recorded participants that have not proved their identity yet, of all addresses and of one. Everyone
  /// can announce identities without keys, and the library stores each until its lease ends. It stores 256 participants
  /// in each traffic class (qos/), so 159 places of a class stay free for members: 256 - 96, without the own one. The
  /// participants of 16 programs of one machine can join at once; others wait until some have proved their identity.
  static constexpr std::size_t kMaxUnproved = 96, kMaxUnprovedFromAddress = 48;
  /// An announcement with this lease or a longer one is refused. Programs of this project state 4 s, other libraries up
  /// to 20 s.
  static constexpr std::chrono::seconds kMaxLease{30};
  /// Time after the first announcement of an unproved participant, after which its announcements are refused for two of
  /// its leases. Otherwise it could occupy its place for ever. One whose handshake has failed has its place for
  /// at least this time, also if it has ended.
  static constexpr std::chrono::seconds kMaxUnprovedTime{30};
  /// Longer than the handshake takes if many of its messages are lost: the library repeats each after half a second.
  static constexpr std::chrono::seconds kMaxHandshake{10};
  /// A participant that announces to have removed this one is removed too, but only if nothing encrypted has arrived in
  /// its name for kMinSilence, and if its identity has been proved for kMinProved. Everyone can forge an announcement;
  /// the roster entry and the metrics of a program, once a second each, contradict it. Only the participants of the
  /// traffic class session send these.
  static constexpr std::chrono::seconds kMinSilence{2}, kMinProved{10};
  /// Messages of handshakes with programs of these keys that the library reads from each participant: in a second, and
  /// at once. There may be several such programs, and each gets the messages for all. Each one costs the library a
  /// verified signature, and with Fast DDS 2.9.1 some 4 KB that it never frees: PKIDH::begin_handshake_reply reads the
  /// certificate of the sender again after each failure.
  static constexpr std::uint32_t kMaxHandshakeRate = 2, kMaxHandshakeBurst = 32;
  /// Failures after which the library reads no further handshakes of a participant.
  static constexpr int kMaxFailedHandshakes = 3;
  /// Messages of handshakes that the library reads from all unproved participants and from those of one address: in a
  /// second, and at once. Those of participants that prove their identity later do not count. At once, each place has
  /// four messages: two of a handshake, and two repeated ones.
  static constexpr std::uint32_t kMaxUnprovedRate = 2, kMaxUnprovedRateOfAddress = 1;
  static constexpr std::uint32_t kMaxUnprovedBurst = 4 * kMaxUnproved,
                                 kMaxUnprovedBurstOfAddress = 4 * kMaxUnprovedFromAddress;
  /// Max number of revoked certificates that only earlier lists name.
  static constexpr std::size_t kMaxEarlierRevoked = 10'000;

  /// Returns the time in ns; never decreases.
  using Clock = std::function<std::int64_t()>;
  /// `folder`: with the keys of this program, `self`. `participant`: its name in the session. `audit` gets an event for
  /// each refusal; must outlive this.
  Members(std::filesystem::path folder, keys::Member self, const std::string& participant, AuditLog& audit,
          Clock clock = realtime::monotonic_ns);

  /// Returns whether the library may read a message. `from` returns the address of its sender.
  using Address = std::function<std::string()>;
  [[nodiscard]] bool admits(const std::uint8_t* message, std::uint32_t size, const Address& from);

  /// Returns whether a program has to process a sample that `participant` has written to `topic`.
  [[nodiscard]] bool is_author(const GuidPrefix& participant, const Claim& claim, const char* topic);

  /// Counts a sample whose content no program of this project sends. `reason`: field, and what was expected.
  void report_invalid(const GuidPrefix& participant, const char* topic, const char* reason);

  /// Writes to the audit log that a participant sends more than the rate of a topic.
  void report_excess(const GuidPrefix& participant, const char* topic) const;

  /// Writes to the audit log that this program, an HRTC, may not serve a user whom the program with this id brings.
  void report_refused_user(std::uint64_t client, const std::string& user) const;

  /// Returns the ids of the program with this participant, and of other programs of its member; none if it is not
  /// known.
  [[nodiscard]] std::vector<std::uint64_t> ids_of(const GuidPrefix& participant) const;

  /// The library has received an announcement that `admits` let pass. If the participant has not proved its identity
  /// within kMaxHandshake of its first one, writes this to the audit log.
  void on_announcement(const GuidPrefix& participant);

  /// The library reports whether a participant has proved its identity.
  void on_authentication(const GuidPrefix& participant, bool succeeded);

  /// The library reports that a participant has left, or that its lease has ended. It has to prove its identity again.
  void on_gone(const GuidPrefix& participant);

  /// Returns the participants that the library has removed, that announce themselves again, and that have not proved
  /// their identity yet; the newest removal first.
  [[nodiscard]] std::vector<GuidPrefix> removed() const;

  /// An announcement in the name of `participant` states that it has removed a participant of this program
  /// (wire/transport/removals.hpp). If that is plausible (kMinSilence, kMinProved), `admits` refuses its messages until
  /// the library reports that its lease has ended.
  void on_removed_by(const GuidPrefix& participant);

  /// Reads the list of revoked certificates again, and cuts off those that are revoked or have expired. Does not use a
  /// list that is older than the one in use. A certificate that an earlier list names stays revoked. Returns messages
  /// for the log: a new list, one that cannot be used or lacks keys, members that were cut off, members that use
  /// another list, and the end of this program's own certificate.
  [[nodiscard]] std::vector<std::string> check_again(std::time_t now);

  /// Returns when the authority has made the list of revoked certificates that this program uses.
  [[nodiscard]] std::time_t list_made() const;

 private:
  struct Certificate {
    std::string subject;  // role and name
    std::string name, serial;
    keys::Role role = keys::Role::kObserver;
    std::time_t valid_until = 0;
    keys::Permitted permitted;
    std::vector<std::uint64_t> permitted_ids;
    std::vector<std::uint64_t> ids;  // of its programs, from samples with their names; the newest last
    std::uint32_t refused = 0;       // samples in the window, of which the first was refused at this time
    std::int64_t refused_since_ns = 0;
    bool is_cut_off = false;
  };
  struct Participant {
    static constexpr std::size_t kMaxIds = 4;
    keys::GuidBegin certificate{};
    // Of the names that its announcements state. Everyone can repeat an announcement with another name of its member.
    std::vector<std::uint64_t> ids;
    std::int64_t announced_ns = 0;
    std::string address = {};            // of the sender of its first announcement
    std::int64_t recorded_ns = 0;        // time of its first announcement
    std::int64_t lease_ns = 0;           // the longest one that it has stated
    std::int64_t expected_since_ns = 0;  // first announcement that the library has received; 0: none
    std::int64_t encrypted_ns = 0;       // time of its newest encrypted message
    std::int64_t proved_ns = 0;          // time of the proof of its identity
    std::int64_t refused_until_ns = 0;   // all its messages are refused, so that the library removes it
    bool is_proved = false;
    Allowance handshakes{kMaxHandshakeRate, kMaxHandshakeBurst, 0};
    std::uint32_t unproved_handshakes = 0;  // messages that the library has read while it was unproved
    int failed_handshakes = 0;
    std::time_t list_made = 0;  // of the list of revoked certificates that it uses; 0: not yet known
    int differing_checks = 0;   // number of checks since that list and the own one differ
  };

  [[nodiscard]] bool admits_announcement(const RtpsBytes& payload, const GuidPrefix& sender, const Address& from);
  [[nodiscard]] bool admits_handshakes(const std::vector<RtpsBytes>& handshakes, const GuidPrefix& sender,
                                       const Address& from);
  [[nodiscard]] bool has_few_handshakes(Participant& participant, std::size_t more);
  [[nodiscard]] bool record(const keys::Identity& identity, const GuidPrefix& sender, std::int64_t lease_ns,
                            const Address& from);
  [[nodiscard]] bool is_revoked(const std::string& serial) const;
  [[nodiscard]] const char* reason_to_cut_off(const keys::Identity& identity, const keys::GuidBegin& begin) const;
  [[nodiscard]] const std::string* other_member_with(std::uint64_t id, const keys::GuidBegin& certificate) const;
  [[nodiscard]] bool is_id_of_another(std::uint64_t id, const keys::GuidBegin& certificate) const;
  void pass_on_ids(const keys::GuidBegin& earlier);
  [[nodiscard]] bool has_ended(const Participant& participant) const;
  [[nodiscard]] static bool may_forget(const Participant& participant, std::int64_t now_ns);
  [[nodiscard]] bool has_room(const std::string& address) const;
  [[nodiscard]] bool make_room(const std::string& address);
  [[nodiscard]] bool is_sender(const Participant& author, const Certificate& certificate, const Claim& claim) const;
  [[nodiscard]] static bool states_own_name(const Certificate& certificate, const Claim& claim);
  [[nodiscard]] bool may_be_diverted(const Participant& author, const Certificate& certificate,
                                     const Claim& claim) const;
  static void learn_id(Certificate& certificate, std::uint64_t id);
  /// The event of the audit log that refuses a sample; null if it is not refused.
  [[nodiscard]] const char* refusal_of(const Participant& author, const Certificate& certificate, const Claim& claim,
                                       const char* topic) const;
  [[nodiscard]] static bool has_permitted_users(const Certificate& certificate, const session::RosterEntry& entry);
  void record_removal(const GuidPrefix& participant);
  void count_refused(const keys::GuidBegin& begin);
  void cut_off(const keys::GuidBegin& begin, const char* why);
  void read_list(std::vector<std::string>& reports);
  void compare_lists(std::vector<std::string>& reports);

  const std::filesystem::path folder_;
  const keys::Member self_;
  const std::uint64_t own_id_;
  const keys::GuidBegin own_begin_;
  AuditLog& audit_;
  const Clock clock_;
  mutable realtime::InheritingMutex mutex_;  // for the members below
  std::set<std::string> revoked_;            // serial numbers in all lists that this program has read
  std::time_t list_made_ = 0;                // of the newest one
  std::map<keys::GuidBegin, Certificate> certificates_;
  std::map<GuidPrefix, Participant> participants_;
  std::map<GuidPrefix, std::int64_t> removed_ns_;  // times of on_gone
  std::int64_t made_room_ns_ = 0;
  // Of unproved participants, and of those of each address.
  Allowance unproved_handshakes_{kMaxUnprovedRate, kMaxUnprovedBurst, 0};
  std::map<std::string, Allowance> unproved_handshakes_from_;
};

}  // namespace tactus::wire
