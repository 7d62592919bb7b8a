#include "wire/transport/protection.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <string>
#include <vector>

#include "rtps_bytes.hpp"

namespace tactus::wire {
namespace {

using namespace test;

Bytes sample(const Bytes& writer, const Bytes& payload = {0, 1, 0, 0, 5, 5, 5, 5}) { return data(writer, 1, payload); }
Bytes secure_body() {
  Bytes body{0, 0, 0, 36};
  body.resize(40, 9);
  return body;
}
/// An encrypted submessage that states `proofs` and has the bytes of `present` ones.
Bytes encrypted(std::uint8_t key, std::uint8_t proofs, unsigned present) {
  Bytes made = submessage(kSecurePrefixId, {0, 0, 0, 4, 0, 0, 0, key, 1, 2, 3, 4, 1, 2, 3, 4, 5, 6, 7, 8});
  const Bytes body = submessage(kSecureBodyId, secure_body());
  Bytes tag(16, 7);
  tag.insert(tag.end(), {0, 0, 0, proofs});
  tag.resize(tag.size() + 20 * std::size_t{present}, 6);
  const Bytes postfix = submessage(kSecurePostfixId, tag);
  made.insert(made.end(), body.begin(), body.end());
  made.insert(made.end(), postfix.begin(), postfix.end());
  return made;
}
const Bytes kSender = Bytes(12, 1);  // of message_of

constexpr std::uint8_t kGuid = 0x50, kKeyHash = 0x70;
/// A parameter with the GUID of a participant, big-endian.
Bytes parameter(std::uint8_t id, const Bytes& participant) {
  Bytes made{0, id, 0, 16};
  made.insert(made.end(), participant.begin(), participant.end());
  made.insert(made.end(), {0, 0, 1, 0xc1});
  return made;
}
/// A message of the authentication from `source`, with a handshake that has these participant data.
Bytes handshake_with(const Bytes& source, const std::vector<Bytes>& parameters) {
  Bytes list;
  for (const Bytes& one : parameters) list.insert(list.end(), one.begin(), one.end());
  list.insert(list.end(), {0, 1, 0, 0});  // the sentinel
  return handshake(source, {'P', 'E', 'M', 0}, list);
}
Bytes handshake_of(const Bytes& source, const Bytes& participant) {
  return handshake_with(source, {parameter(kGuid, participant)});
}
Refusal refusal(const std::vector<Bytes>& parts) {
  const Bytes message = message_of(parts);
  return refusal_of(message.data(), static_cast<std::uint32_t>(message.size()));
}

const Bytes kAnnouncement{0x00, 0x01, 0x00, 0xc2}, kAuthentication{0x00, 0x02, 0x01, 0xc3}, kUserWriter{0, 0, 1, 2},
    kEndpointDiscovery{0x00, 0x00, 0x03, 0xc2}, kKeyExchange{0xff, 0x02, 0x02, 0xc3};

TEST(ProtectionTest, AnnouncementsAndAuthenticationArePlain) {
  EXPECT_EQ(refusal({kInfoTime, sample(kAnnouncement)}), Refusal::kNone);
  EXPECT_EQ(refusal({kInfoDestination, kInfoTime, sample(kAuthentication, handshake_of(kSender, kSender))}),
            Refusal::kNone);
}

TEST(ProtectionTest, TheAuthenticationSpeaksForItsSender) {
  Bytes other = kSender;
  other[11] = 2;
  EXPECT_EQ(refusal({sample(kAuthentication, handshake_of(other, kSender))}), Refusal::kOther);
  EXPECT_EQ(refusal({sample(kAuthentication, handshake_of(kSender, other))}), Refusal::kOther);
  Bytes without_participant = handshake_of(kSender, kSender);
  without_participant[without_participant.size() - 36] = 'x';  // "c.pdata" becomes "x.pdata"
  EXPECT_EQ(refusal({sample(kAuthentication, without_participant)}), Refusal::kOther);
  EXPECT_EQ(refusal({sample(kAuthentication)}), Refusal::kOther) << "too short";
}

// The library reads a handshake less strictly.
TEST(ProtectionTest, TheLibraryReadsNoOtherParticipantInAHandshake) {
  Bytes other = kSender;
  other[11] = 2;
  const auto refusal_of_parameters = [](const std::vector<Bytes>& parameters) {
    return refusal({sample(kAuthentication, handshake_with(kSender, parameters))});
  };
  EXPECT_EQ(refusal_of_parameters({parameter(kKeyHash, other), parameter(kGuid, kSender)}), Refusal::kOther)
      << "it takes a key hash for the GUID";
  EXPECT_EQ(refusal_of_parameters({{0, 9, 0, 1, 7}, parameter(kGuid, kSender)}), Refusal::kOther)
      << "it rounds lengths up";
  EXPECT_EQ(refusal_of_parameters({{0, 9, 0, 4, 7, 7, 7, 7}, parameter(kGuid, kSender)}), Refusal::kNone);

  Bytes unended = handshake_of(kSender, other);
  for (const std::string name : {"c.id", "c.pdata"})
    *(std::search(unended.begin(), unended.end(), name.begin(), name.end()) +
      static_cast<std::ptrdiff_t>(name.size())) = 'X';
  EXPECT_EQ(refusal({sample(kAuthentication, unended)}), Refusal::kOther) << "it does not look at the end of a name";
}

TEST(ProtectionTest, TheCertificateOfAHandshakeIsFound) {
  const auto text_of = [](const Bytes& payload) {
    const RtpsBytes found = certificate_in({payload.data(), static_cast<std::uint32_t>(payload.size()), false});
    return std::string{found.at, found.at + found.size};
  };
  EXPECT_EQ(text_of(handshake(kSender, {'P', 'E', 'M'}, parameter(kGuid, kSender))), "PEM");
  EXPECT_EQ(text_of(Bytes(200)), "");
  EXPECT_EQ(text_of({}), "");
}

TEST(ProtectionTest, AMessageWithoutContentIsRefused) {
  for (const std::vector<Bytes>& parts : std::vector<std::vector<Bytes>>{
           {}, {kInfoTime}, {kInfoDestination}, {kInfoDestination, kInfoTime}, {submessage(kPadId, Bytes(4, 0))}})
    EXPECT_EQ(refusal(parts), Refusal::kMalformed) << parts.size() << " submessages";
}

TEST(ProtectionTest, InlineQosCannotEndAParticipant) {
  const auto announcement_with = [](std::uint8_t low, std::uint8_t high) {
    Bytes made = sample(kAnnouncement);
    made[1] |= 0x02;
    made.insert(made.begin() + 24, {low, high, 4, 0, 0, 0, 0, 1, 1, 0, 0, 0});
    made[2] = static_cast<std::uint8_t>(made[2] + 12);
    return made;
  };
  EXPECT_EQ(refusal({announcement_with(0x71, 0)}), Refusal::kLeave) << "status";
  EXPECT_EQ(refusal({announcement_with(0x70, 0)}), Refusal::kLeave) << "key hash";
  EXPECT_EQ(refusal({announcement_with(0x0f, 0x80)}), Refusal::kNone) << "the announcement that it answers";
  EXPECT_EQ(refusal({announcement_with(0x83, 0x00)}), Refusal::kNone) << "the same, by the name of the standard";
}

TEST(ProtectionTest, AllOtherPlainSubmessagesAreRefused) {
  for (const Bytes& writer : {kUserWriter, kEndpointDiscovery, kKeyExchange})
    EXPECT_EQ(refusal({kInfoDestination, kInfoTime, sample(writer)}), Refusal::kPlain);
  for (const std::uint8_t id : {kAckNackId, kHeartbeatId, kGapId})
    EXPECT_EQ(refusal({submessage(id, Bytes(28, 0))}), Refusal::kControl) << int{id};
  constexpr std::uint8_t kInfoSource = 0x0c, kDataFragment = 0x16, kWholeMessagePrefix = 0x33;
  for (const std::uint8_t id : {kInfoSource, kDataFragment, kWholeMessagePrefix})
    EXPECT_EQ(refusal({submessage(id, Bytes(28, 0))}), Refusal::kPlain) << int{id};
  EXPECT_EQ(refusal({sample(kAnnouncement), sample(kUserWriter)}), Refusal::kPlain) << "after one that is accepted";
  EXPECT_EQ(refusal({encrypted(1, 1, 1), sample(kUserWriter)}), Refusal::kPlain);
}

TEST(ProtectionTest, APlainAnnouncementCannotEndAParticipant) {
  EXPECT_EQ(refusal({kInfoTime, sample(kAnnouncement, {})}), Refusal::kLeave);
}

TEST(ProtectionTest, AnEncryptedSubmessageProvesItsOrigin) {
  EXPECT_EQ(refusal({kInfoTime, encrypted(1, 1, 1)}), Refusal::kNone);
  EXPECT_EQ(refusal({encrypted(1, 3, 3), encrypted(2, 1, 1)}), Refusal::kNone);
  EXPECT_EQ(refusal({encrypted(1, 0, 0)}), Refusal::kNoOrigin);
  EXPECT_EQ(refusal({encrypted(1, 1, 0)}), Refusal::kNoOrigin) << "states a proof that it does not have";
  EXPECT_EQ(refusal({encrypted(1, 0, 1)}), Refusal::kNoOrigin) << "does not state the proof that it has";
  EXPECT_EQ(refusal({encrypted(1, 1, 1), encrypted(1, 0, 0)}), Refusal::kNoOrigin) << "after one that is accepted";
  EXPECT_EQ(refusal({encrypted(0, 0, 0)}), Refusal::kNone) << "the exchange of keys has a key for two participants";
}

TEST(ProtectionTest, CutMessagesAreRefusedAndNotReadBeyondTheirEnd) {
  const Bytes whole = message_of({encrypted(1, 1, 1)});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_NE(refusal_of(cut.data(), static_cast<std::uint32_t>(size)), Refusal::kNone) << size;
  }
}

TEST(ProtectionTest, DamagedMessagesAreNotReadBeyondTheirEnd) {
  const Bytes whole = message_of({kInfoDestination, sample(kAnnouncement), encrypted(1, 2, 2)});
  std::mt19937 random{7};
  for (int i = 0; i < 100'000; ++i) {
    Bytes damaged = whole;
    for (int k = 0; k < 3; ++k) damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
    damaged.resize(random() % (whole.size() + 1));
    damaged.shrink_to_fit();
    (void)refusal_of(damaged.data(), static_cast<std::uint32_t>(damaged.size()));  // sanitizers detect wrong reads
  }
}

}  // namespace
}  // namespace tactus::wire
