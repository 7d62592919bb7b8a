/// Writes the seeds of all fuzz targets to the folder of the first argument: valid files and messages, from which a
/// fuzzer finds its way to damaged ones. The second argument is the folder of the sources.
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"
#include "keys/authority.hpp"
#include "keys/identity.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/random_model.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/wire/rtps_bytes.hpp"
#include "trace/flight_file.hpp"
#include "trace/mcap.hpp"
#include "wire/topics.hpp"

namespace tactus::fuzz {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

class Seeds {
 public:
  explicit Seeds(fs::path folder) : folder_{std::move(folder)} {}
  /// Returns the path of a new seed.
  [[nodiscard]] fs::path next(const std::string& target) {
    fs::create_directories(folder_ / target);
    return folder_ / target / std::to_string(++count_);
  }
  void add(const std::string& target, std::span<const std::uint8_t> bytes) {
    std::ofstream{next(target), std::ios::binary}.write(reinterpret_cast<const char*>(bytes.data()),
                                                        static_cast<std::streamsize>(bytes.size()));
  }
  void add(const std::string& target, const std::string& text) {
    add(target, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }

 private:
  fs::path folder_;
  int count_ = 0;
};

void add_models(Seeds& seeds) {
  const spm::OwnedModel owned = test_support::random_model(1, 500, 3);  // as in region.cpp and cache.cpp
  const spm::codec::EncodedModel encoded{owned.model()};
  const spm::codec::CompressedModel& model = encoded.compressed();
  seeds.add("base", model.spans().base);
  seeds.add("directory", spm::codec::encode_page(spm::page_with_id(model.regions(), spm::page_of(model.regions()[0]))));
  seeds.add("directory", spm::codec::encode_pages(model.regions()));
  for (std::uint32_t region = 0; region < model.summary().regions && region < 5; ++region) {
    const std::vector<spm::Interval> list = model.intervals_of(spm::RegionId{region});
    seeds.add("region", *spm::codec::encode_region(model, spm::RegionId{region}, list));
  }
  Bytes operations;  // as in cache.cpp
  for (std::uint8_t region = 0; region < model.summary().regions && region < 5; ++region) {
    std::vector<spm::Interval> missing = model.intervals_of(spm::RegionId{region});
    if (region > 0) missing.clear();  // incomplete, unless region 0 lists all records
    for (const bool is_whole : {false, true}) {
      if (is_whole) missing = model.intervals_of(spm::RegionId{region});
      const Bytes message = *spm::codec::encode_region(model, spm::RegionId{region}, missing);
      operations.insert(operations.end(), {0, region, static_cast<std::uint8_t>(message.size()),
                                           static_cast<std::uint8_t>(message.size() >> 8)});
      operations.insert(operations.end(), message.begin(), message.end());
    }
    for (const int operation : {1, 3, 4, 2})
      operations.insert(operations.end(), {static_cast<std::uint8_t>(operation), region, 0, 0});
    seeds.add("cache", operations);
  }
  for (std::uint8_t region = 0; region < 5; ++region)
    operations.insert(operations.end(), {3, region, 0, 0, 5, region, 0, 0});
  seeds.add("cache", operations);
  spm::offline::write_model(seeds.next("model_file"), owned.model(), {"seed.obj", {}});
}

void add_samples(Seeds& seeds) {
  std::uint8_t topic = 0;
  wire::topics::for_each([&](const auto&) {
    for (const std::size_t size : {100u, 400u}) {
      Bytes bytes{topic, 0, 1, 0, 0};  // little-endian CDR
      bytes.resize(size);
      seeds.add("sample", bytes);
    }
    ++topic;
  });
}

void add_datagrams(Seeds& seeds) {
  using namespace wire::test;
  // As datagram.cpp's authority would issue it: the GUID begins with the hash of the identity.
  const keys::Identity museum{keys::Role::kHost, "museum", "0A1B", 4'000'000'000, {"vase", "crate"}, "museum"};
  const std::string identity = text_of(museum);
  wire::GuidPrefix sender{};
  const keys::GuidBegin begin = keys::guid_begin_of("lab-keys", museum);
  std::copy(begin.begin(), begin.end(), sender.begin());
  Bytes announcement{0, 3, 0, 0, 0x50, 0, 16, 0};
  announcement.insert(announcement.end(), sender.begin(), sender.end());
  announcement.insert(announcement.end(), {0, 0, 1, 0xc1});
  const auto size = static_cast<std::uint8_t>((identity.size() + 3) / 4 * 4);
  announcement.insert(announcement.end(), {0x2c, 0, static_cast<std::uint8_t>(size + 4), 0,
                                           static_cast<std::uint8_t>(identity.size()), 0, 0, 0});
  announcement.insert(announcement.end(), identity.begin(), identity.end());
  announcement.resize(announcement.size() + size - identity.size());
  announcement.insert(announcement.end(), {1, 0, 0, 0});
  seeds.add("datagram", message_of({kInfoTime, data({0x00, 0x01, 0x00, 0xc2}, 1, announcement)}, sender));
  seeds.add("datagram", message_of({kInfoDestination, kInfoTime, data({0, 0, 1, 2}, 9, {0, 1, 0, 0, 5, 5, 5, 5}),
                                    submessage(wire::kStatisticsId, Bytes(56, 0))}));
  seeds.add("datagram",
            message_of({submessage(wire::kSecurePrefixId, Bytes(20, 1)), submessage(wire::kSecureBodyId, Bytes(40, 2)),
                        submessage(wire::kSecurePostfixId, Bytes(40, 1))}));
  seeds.add("datagram", std::string(wire::kRtpsHeader, 'R') + identity);
}

void add_keys(Seeds& seeds) {
  const test_support::TemporaryFolder folder;
  const keys::Authority authority = keys::Authority::create(folder.path() / "seeds");
  keys::NewMember member;
  member.name = "laptop";
  member.role = keys::Role::kUser;
  member.permitted = {"ann", "bob"};
  const fs::path made = authority.add(member);
  authority.revoke("laptop");
  char kind = 0;
  for (const char* file :
       {keys::files::kCertificate, keys::files::kRevoked, keys::files::kPrivateKey, keys::files::kPermissions})
    seeds.add("keys", kind++ + test_support::read_bytes(made / file));
}

void add_recordings(Seeds& seeds) {
  trace::McapWriter writer{seeds.next("recording"), "seeds"};
  const auto channel = writer.add_channel(writer.add_schema("a::B", "omgidl", "module a { struct B { long c; }; };"),
                                          "tactus_roster", "cdr", {{"partition", "lab"}});
  const Bytes message{0, 1, 0, 0, 7, 0, 0, 0};
  for (std::uint32_t i = 0; i < 3; ++i) writer.write(channel, 1000 + i, 900 + i, i, message);
  writer.flush();
  writer.write(channel, 2000, 1900, 3, message);
  writer.close();

  trace::FlightFileWriter flight{seeds.next("flight")};
  for (const trace::FlightMessage& part :
       {trace::FlightMessage{trace::FlightStart{}}, trace::FlightMessage{trace::FlightObject{}},
        trace::FlightMessage{trace::FlightState{}}, trace::FlightMessage{trace::FlightEvent{}},
        trace::FlightMessage{trace::FlightMove{}}, trace::FlightMessage{trace::FlightProbe{}},
        trace::FlightMessage{trace::FlightTouch{}}, trace::FlightMessage{trace::FlightRefine{}}})
    flight.write(part);
  flight.close();
}

void add_schemas(Seeds& seeds, const fs::path& sources) {
  const std::string sample("\0\1\0\0\7\0\0\0\1\0\0\0\2\0\0\0x\0\0\0\1\0\0\0", 24);
  seeds.add("idl",
            "a::S\nmodule a { const long kTwo = 2; enum E { kOne, kOther }; typedef short Pair[kTwo]; @final struct S {"
            " Pair p; sequence<E, 4> e; string<4> t; @key unsigned long n; }; };" +
                std::string(1, '\0') + sample);
  const std::string flight = test_support::read_bytes(sources / "idl/flight.idl");
  for (const char* type : {"Start", "State", "Touch"})
    seeds.add("idl", "tactus::flight::" + std::string{type} + "\n" + flight + std::string(1, '\0') + sample +
                         std::string(500, '\0'));
}

/// Writes with a cycle after each, at places that are spread over the whole memory.
void add_writes(Seeds& seeds) {
  for (std::uint32_t seed = 0; seed < 8; ++seed) {
    Bytes bytes;
    for (std::uint32_t i = 0; i < 64; ++i) {
      const std::uint32_t offset = (seed * 64 + i) * 8191;
      Bytes write(16, static_cast<std::uint8_t>(seed % 2 == 0 ? 0xff : i));
      std::memcpy(write.data(), &offset, sizeof offset);
      write[4] = 7;
      write[5] = 1;
      bytes.insert(bytes.end(), write.begin(), write.end());
    }
    seeds.add("shared_block", bytes);
  }
}

void add_texts(Seeds& seeds, const fs::path& sources) {
  for (const client_sim::BuiltInScenario& scenario : client_sim::built_in_scenarios())
    seeds.add("scenario", std::string{scenario.text});
  fs::copy_file(sources / "examples/object/crate.yaml", seeds.next("host_config"));
  for (const char* request :
       {R"({"token": "0a"})", R"({"seen": 8})", R"({"stop": "a reason"})",
        R"({"touch": {"user": "guest", "hrtc": "desk"}})", R"({"hand": {"target": [0.5, -1, 2], "grab": true}})",
        R"({"show": "desk"})", R"({"release": true})", R"({"play": true})", R"({"seek": 12.5})",
        R"({"camera": {"position": [0, 0, 1], "direction": [0, 0, -1], "angle": 0.8, "height": 600}})"})
    seeds.add("page_request", std::string{request});
}

}  // namespace
}  // namespace tactus::fuzz

int main(int argc, char** argv) try {
  using namespace tactus::fuzz;
  if (argc != 3) {
    std::fputs("usage: fuzz_seeds FOLDER SOURCES\n", stderr);
    return 2;
  }
  std::filesystem::remove_all(argv[1]);
  Seeds seeds{argv[1]};
  add_models(seeds);
  add_samples(seeds);
  add_datagrams(seeds);
  add_keys(seeds);
  add_writes(seeds);
  add_recordings(seeds);
  add_schemas(seeds, argv[2]);
  add_texts(seeds, argv[2]);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "fuzz_seeds: %s\n", error.what());
  return 1;
}
