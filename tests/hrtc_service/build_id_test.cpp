#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

namespace fs = std::filesystem;

/// Returns the files that `root` includes, directly or not, and the source files of the included headers.
std::set<std::string> files_behind(const std::string& root) {
  const fs::path top{TACTUS_SOURCE_DIR};
  std::set<std::string> found;
  std::vector<std::string> open{root};
  const auto add = [&](const std::string& file) {
    if (fs::exists(top / file) && found.insert(file).second) open.push_back(file);
  };
  while (!open.empty()) {
    const fs::path file = open.back();
    open.pop_back();
    add(file.string());
    add(fs::path{file}.replace_extension(".cpp").string());
    std::ifstream text{top / file};
    for (std::string line; std::getline(text, line);) {
      constexpr std::string_view kInclude = "#include \"";
      if (line.rfind(kInclude, 0) == 0) add(line.substr(kInclude.size(), line.rfind('"') - kInclude.size()));
    }
  }
  return found;
}

class BuildId : public ::testing::Test {
 protected:
  void put(const std::string& file, const std::string& text) const {
    fs::create_directories((folder_.path() / file).parent_path());
    test_support::write_bytes(folder_.path() / file, text);
  }
  /// Returns the generated source of the build id of the files that were put.
  [[nodiscard]] std::string generate(const std::string& options = "-O2") const {
    const std::string out = (folder_.path() / "build_id.out").string();
    const std::string command = "'" TACTUS_CMAKE "' '-DSOURCE=" + folder_.path().string() + "' '-DOUT=" + out +
                                "' -DCOMPILER=c '-DOPTIONS=" + options +
                                "' -P '" TACTUS_SOURCE_DIR "/hrtc_service/servo/build_id.cmake'";
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    return test_support::read_bytes(out);
  }
  test_support::TemporaryFolder folder_;
};

TEST_F(BuildId, ChangesWithEachFileThatComputesForces) {
  const std::set<std::string> files = files_behind("hrtc_service/servo/servo.cpp");
  for (const char* const file :
       {"hrtc_service/servo/cycle.cpp", "hrtc_service/servo/sphere_touch.cpp", "hrtc_service/servo/tool_touch.cpp",
        "hrtc_service/servo/held_object.cpp", "hrtc_service/servo/bodies.cpp", "sharing/body.cpp", "haptics/proxy.cpp",
        "spm/forest.cpp", "spm/triangle_gap_kernel.inc"})
    ASSERT_THAT(files, testing::Contains(file));
  for (const std::string& file : files) put(file, "before");
  const std::string before = generate();
  for (const std::string& file : files) {
    put(file, "after");
    EXPECT_NE(generate(), before) << file;
    put(file, "before");
  }
  EXPECT_EQ(generate(), before);
}

TEST_F(BuildId, ChangesWithTheCompilerOptionsOfAModule) {
  for (const char* const file : {"cmake/TactusTargets.cmake", "spm/CMakeLists.txt"}) {
    put(file, "before");
    const std::string before = generate();
    put(file, "after");
    EXPECT_NE(generate(), before) << file;
  }
  EXPECT_NE(generate("-O2"), generate("-O3"));
}

}  // namespace
}  // namespace tactus::hrtc_service
