/// Records a session, decodes the recording with a reader in Python that was written from
/// docs/reference/stream-format.md, and compares the regions and the finest mesh with those of the .spm file.
#include <array>
#include <cstdio>

#include "spm/offline/model_file.hpp"
#include "tests/e2e/session_test.hpp"
#include "tests/formats/python.hpp"

namespace tactus::e2e {
namespace {

using formats::missing_python;
using formats::python;
using formats::reader;
using Seen = Observer::Seen;
using test_support::read_bytes;
using testing::HasSubstr;

class StreamFormat : public SessionTest {
 protected:
  void SetUp() override {
    if (const std::string reason = missing_python(); !reason.empty()) GTEST_SKIP() << reason;
    for (const std::vector<std::string>& arguments :
         {std::vector<std::string>{"generate", "organ", path("organ.spm"), "--faces", "6000", "--cell-faces", "100"},
          std::vector<std::string>{"export", path("organ.spm"), path("organ.ply")}}) {
      Process mesh{program("mesh", arguments)};
      ASSERT_EQ(mesh.wait(), 0) << mesh.output();
    }
    const spm::offline::MappedModel model{path("organ.spm")};
    regions_ = model.summary().regions;
    std::array<char, 17> digits{};
    std::snprintf(digits.data(), digits.size(), "%016llx", static_cast<unsigned long long>(model.summary().digest));
    digest_ = digits.data();
  }

  /// Records a session in which users of two HRTCs touch the object. A chunk that the recorder loses from one stream is
  /// in the other one. Ends when both HRTCs have `regions` regions.
  void record_session(const std::string& file, const std::string& size, const std::string& tip_mm,
                      std::uint32_t regions) const {
    Observer observer{address("observer")};
    Process recorder{in_session("record", {file})};
    ASSERT_TRUE(recorder.wait_for_line("recording session"));
    const std::string config =
        write("host.yaml", "objects:\n  - {name: organ, model: " + path("organ.spm") + ", size: " + size + "}\n");
    Process museum{in_session("host", {"--name", "museum", "--config", config})};
    Process desk{hrtc("desk", {"--tip-radius", tip_mm})};
    Process lab{hrtc("lab", {"--tip-radius", tip_mm})};
    Process users{sim(R"(name: recorded
duration: 120
users:
  - {name: ann, hrtc: desk, script: [{approach: {object: "#1", speed: 0.2}}, {follow: {seconds: 110, pattern: around}}]}
  - {name: bob, hrtc: lab, script: [{approach: {object: "#1", speed: 0.2}}, {follow: {seconds: 110, pattern: around}}]}
)")};
    EXPECT_TRUE(observer.until([&](const Seen& seen) {
      return seen.figure("desk", "hrtc.regions_held") >= regions && seen.figure("lab", "hrtc.regions_held") >= regions;
    })) << users.output()
        << desk.output() << lab.output() << "regions held: " << observer.seen().figure("desk", "hrtc.regions_held")
        << ", " << observer.seen().figure("lab", "hrtc.regions_held");
    users.signal(SIGINT);
    EXPECT_TRUE(exits_with(1, users));
    EXPECT_TRUE(exits_with(0, desk));
    EXPECT_TRUE(exits_with(0, lab));
    EXPECT_TRUE(exits_with(0, museum));
    recorder.signal(SIGINT);
    EXPECT_TRUE(exits_with(0, recorder));
  }

  std::uint32_t regions_ = 0;
  std::string digest_;
};

TEST_F(StreamFormat, ARecordingOfAllRegionsHasTheFinestMesh) {
  record_session(path("all.mcap"), "0.03", "100", regions_);  // the object is smaller than a tip
  const std::string all = std::to_string(regions_) + " of " + std::to_string(regions_) + " regions";
  Process decode{reader("stream_reader.py", {path("all.mcap"), path("found")})};
  EXPECT_TRUE(exits_with(0, decode));
  EXPECT_THAT(decode.output(), HasSubstr("organ, digest " + digest_ + ": " + all));
  EXPECT_TRUE(read_bytes(path("found-" + digest_ + ".ply")) == read_bytes(path("organ.ply"))) << decode.output();
  Process compare{python(TACTUS_COMPARE_REGIONS, {path("all.mcap"), path("organ.spm")})};
  EXPECT_TRUE(exits_with(0, compare)) << compare.output();
  EXPECT_THAT(compare.output(), HasSubstr(all + " are equal"));
}

TEST_F(StreamFormat, EachDeliveredRegionEqualsThatOfTheModel) {
  record_session(path("some.mcap"), "0.1", "3", 8);
  Process compare{python(TACTUS_COMPARE_REGIONS, {path("some.mcap"), path("organ.spm")})};
  EXPECT_TRUE(exits_with(0, compare)) << compare.output();
  EXPECT_THAT(compare.output(),
              testing::ContainsRegex("^[1-9][0-9]* of " + std::to_string(regions_) + " regions are equal"));
}

}  // namespace
}  // namespace tactus::e2e
