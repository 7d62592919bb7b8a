#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/mman.h>
#include <unistd.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"
#include "tools/doctor/facts.hpp"
#include "tools/doctor/findings.hpp"
#include "tools/doctor/vulnerabilities.hpp"

namespace tactus::doctor {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// A machine without defects.
Facts sound_machine() {
  Facts facts;
  facts.interfaces = {{"lo", "127.0.0.1", 65536, true, false, false}, {"eth0", "10.0.0.2", 1500, false, true, true}};
  facts.required = {1472, 4194304, 1048576};
  facts.receive_buffer_max = facts.send_buffer_max = 4194304;
  facts.has_fifo = facts.can_lock_memory = true;
  facts.priority = 60;
  facts.rt_runtime_us = 950000;
  facts.lateness = {20, 60, 300};
  facts.clock_source = "tsc";
  facts.clock_read_ns = 25;
  facts.domain = 20;
  facts.first_ephemeral_port = 32768;
  facts.kernel = "6.1";
  facts.library = "2.14.0";
  facts.match_time_s = 0.012;
  return facts;
}

/// The findings that are faults or advice.
std::vector<Finding> problems(const Facts& facts) {
  std::vector<Finding> found;
  for (const Finding& finding : judge(facts))
    if (finding.severity != Severity::kGood) found.push_back(finding);
  return found;
}

TEST(Doctor, FindsNothingOnASoundMachine) { EXPECT_THAT(problems(sound_machine()), IsEmpty()); }

struct Defect {
  const char* name;
  std::function<void(Facts&)> apply;
  Severity severity;
  const char* check;
  const char* found;
  const char* remedy;
};
void PrintTo(const Defect& defect, std::ostream* out) { *out << defect.name; }

class EveryDefect : public testing::TestWithParam<Defect> {};

TEST_P(EveryDefect, IsTheOnlyFindingAndHasARemedy) {
  Facts facts = sound_machine();
  GetParam().apply(facts);
  const std::vector<Finding> found = problems(facts);
  ASSERT_EQ(found.size(), 1u) << text(found);
  EXPECT_EQ(found[0].severity, GetParam().severity);
  EXPECT_EQ(found[0].check, GetParam().check);
  EXPECT_THAT(found[0].found, HasSubstr(GetParam().found));
  EXPECT_THAT(found[0].remedy, HasSubstr(GetParam().remedy));
}

INSTANTIATE_TEST_SUITE_P(
    Doctor, EveryDefect,
    testing::Values(
        Defect{"OnlyLoopback",
               [](Facts& f) {
                 f.interfaces.pop_back();
                 f.multicast_route_error = "Network is unreachable";
               },
               Severity::kAdvice, "interfaces", "loopback", "connect"},
        Defect{"TwoNetworks",
               [](Facts& f) {
                 f.interfaces.push_back({"wlan0", "10.1.0.2", 1500, false, true, true});
               },
               Severity::kAdvice, "interfaces", "wlan0 10.1.0.2", "take down"},
        Defect{"NoRoute", [](Facts& f) { f.multicast_route_error = "Network is unreachable"; }, Severity::kFault,
               "multicast", "unreachable", "ip route add 239.0.0.0/8"},
        Defect{"NoRouteToAPeer",
               [](Facts& f) {
                 f.discovery.peers = {"10.9.9.9"};
                 f.unreachable = {"10.9.9.9 (Network is unreachable)"};
               },
               Severity::kFault, "routes", "10.9.9.9", "ip route"},
        Defect{"NoMulticastReturns", [](Facts& f) { f.interfaces[1].multicast_returns = false; }, Severity::kFault,
               "multicast", "eth0", "--discovery-server"},
        Defect{"SmallMtu", [](Facts& f) { f.interfaces[1].mtu = 1400; }, Severity::kAdvice, "mtu", "eth0 1400",
               "ip link set eth0 mtu 1500"},
        Defect{"SmallReceiveBuffer", [](Facts& f) { f.receive_buffer_max = 212992; }, Severity::kAdvice,
               "socket buffers", "212992, the profiles require 4194304", "sysctl -w net.core.rmem_max=4194304"},
        Defect{"SmallSendBuffer", [](Facts& f) { f.send_buffer_max = 212992; }, Severity::kAdvice, "socket buffers",
               "212992", "net.core.wmem_max=1048576"},
        Defect{"NoPriority", [](Facts& f) { f.has_fifo = false; }, Severity::kAdvice, "real time", "SCHED_FIFO 60",
               "rtprio"},
        Defect{"NoLockedMemory", [](Facts& f) { f.can_lock_memory = false; }, Severity::kAdvice, "locked memory",
               "refused", "memlock"},
        Defect{"UnlimitedRealTimeShare", [](Facts& f) { f.rt_runtime_us = -1; }, Severity::kAdvice, "real-time share",
               "-1", "sched_rt_runtime_us=950000"},
        Defect{"LateWakeUp", [](Facts& f) { f.lateness.p99 = 900; }, Severity::kAdvice, "wake-up", "p99 900", "idle"},
        Defect{"SlowClock", [](Facts& f) { f.clock_source = "hpet"; }, Severity::kAdvice, "clock", "hpet", "tsc"},
        Defect{"BlockedPort", [](Facts& f) { f.blocked_ports = {12650}; }, Severity::kFault, "ports", "12650",
               "ss -lunp"},
        Defect{"PortsInTheEphemeralRange", [](Facts& f) { f.first_ephemeral_port = 10000; }, Severity::kAdvice, "ports",
               "10000", "ip_local_port_range"},
        Defect{"CannotJoin", [](Facts& f) { f.join_error = "no such profile"; }, Severity::kFault, "discovery",
               "no such profile", "correct"},
        Defect{"NoMatch", [](Facts& f) { f.match_time_s.reset(); }, Severity::kFault, "discovery",
               "did not find each other", "firewall"},
        Defect{"NoServer",
               [](Facts& f) {
                 f.discovery.servers = {"10.0.0.5"};
                 f.match_time_s.reset();
               },
               Severity::kFault, "discovery", "through 10.0.0.5", "fast-discovery-server"},
        Defect{"OldLibrary", [](Facts& f) { f.library = "2.9.1"; }, Severity::kAdvice, "vulnerabilities", "CVE",
               "firewall"},
        Defect{"UnusableKeys", [](Facts& f) { f.keys_error = "desk/certificate.pem has expired"; }, Severity::kFault,
               "keys", "has expired", "secure.md"},
        Defect{"KeysThatExpireSoon",
               [](Facts& f) {
                 f.now = 1'800'000'000;
                 f.member.emplace();
                 f.member->name = "desk";
                 f.member->role = keys::Role::kHrtc;
                 f.member->valid_until = f.now + 3 * 24 * 3600;
                 f.member->group = "lab-keys";
               },
               Severity::kAdvice, "keys", "expire in 3 days", "tactus keys add-hrtc lab-keys desk --replace"},
        Defect{"ListOfRevokedKeysOfTheFuture",
               [](Facts& f) {
                 f.now = 1'800'000'000;
                 f.member.emplace();
                 f.member->valid_until = f.now + 365 * 24 * 3600;
                 f.revoked.made = f.now + 24 * 3600;
               },
               Severity::kAdvice, "keys", "list of revoked keys has a wrong time", "secure.md"},
        Defect{"StaleSharedMemory", [](Facts& f) { f.stale_segments = {"fastrtps_port7412"}; }, Severity::kAdvice,
               "shared memory", "fastrtps_port7412", "fastdds shm clean"},
        Defect{"EnvironmentVariable", [](Facts& f) { f.variables = {"ROS_DISCOVERY_SERVER"}; }, Severity::kAdvice,
               "environment", "ROS_DISCOVERY_SERVER", "--discovery-server"}),
    [](const auto& defect) { return defect.param.name; });

TEST(Doctor, ListsTheVulnerabilitiesOfBothVersionsOfTheLibrary) {
  for (const char* version : {"2.9.1", "3.1.2"}) {
    int count = 0;
    for (const Vulnerability& one : vulnerabilities(version)) count += one.count;
    EXPECT_GE(count, 28) << version;
    EXPECT_THAT(text(vulnerabilities(version), version), HasSubstr("CVE-2025-64438")) << version;
  }
  EXPECT_THAT(text(vulnerabilities("3.1.2"), "3.1.2"), Not(HasSubstr("CVE-2023-50257"))) << "corrected there";
  EXPECT_THAT(vulnerabilities("9.9.9"), IsEmpty());
}

TEST(Doctor, NeedsNoMulticastWithUnicastDiscovery) {
  Facts facts = sound_machine();
  facts.multicast_route_error = "Network is unreachable";
  facts.discovery.peers = {"10.0.0.3"};
  EXPECT_THAT(problems(facts), IsEmpty());
}

TEST(Doctor, WritesJsonOfNamesThatAreNotUtf8) {
  const std::vector<Finding> findings{{Severity::kGood, "check", "a\xff", ""}};
  const auto parsed = nlohmann::json::parse(json(findings));
  EXPECT_EQ(parsed.at("findings").at(0).at("found"), "a\xef\xbf\xbd");
}

TEST(Doctor, WritesEveryFindingAsTextAndAsJson) {
  Facts facts = sound_machine();
  facts.has_fifo = false;
  const std::vector<Finding> findings = judge(facts);
  const auto parsed = nlohmann::json::parse(json(findings)).at("findings");
  ASSERT_EQ(parsed.size(), findings.size());
  for (std::size_t i = 0; i < findings.size(); ++i) {
    EXPECT_EQ(parsed[i].at("check"), findings[i].check);
    EXPECT_EQ(parsed[i].at("remedy"), findings[i].remedy);
    EXPECT_THAT(text(findings), HasSubstr(findings[i].found));
  }
  EXPECT_THAT(text(findings), HasSubstr("faults: 0, advice: 1"));
}

class StaleSegments : public testing::Test {
 protected:
  /// Creates a file in the folder. Returns its descriptor.
  int create(const std::string& name) const {
    const int file = ::open((folder_.path() / name).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    EXPECT_GE(file, 0);
    EXPECT_EQ(::ftruncate(file, 1), 0);
    return file;
  }
  test_support::TemporaryFolder folder_;
};

TEST_F(StaleSegments, AreTheFilesThatNoProgramHasMapped) {
  for (const char* name : {"fastrtps_port7400", "fast_datasharing_1", "sem.other"}) ::close(create(name));
  const int file = create("fastrtps_port74001");  // a longer name that begins with that of a stale segment
  void* const memory = ::mmap(nullptr, 1, PROT_READ, MAP_SHARED, file, 0);
  ASSERT_NE(memory, MAP_FAILED);
  ::close(file);
  EXPECT_THAT(stale_segments(folder_.path()), ElementsAre("fast_datasharing_1", "fastrtps_port7400"));
  ::munmap(memory, 1);
  EXPECT_THAT(stale_segments(folder_.path()),
              ElementsAre("fast_datasharing_1", "fastrtps_port7400", "fastrtps_port74001"));
}

TEST_F(StaleSegments, AreNotTheLockFilesThatAProgramHasOpen) {
  const int lock = create("fastrtps_0123_el");
  EXPECT_THAT(stale_segments(folder_.path()), IsEmpty());
  ::close(lock);
  EXPECT_THAT(stale_segments(folder_.path()), ElementsAre("fastrtps_0123_el"));
}

TEST(DoctorProgram, ExitsWithStatusOneOnlyForAFault) {
  const test_support::TestDomain domain;
  e2e::Process doctor{{TACTUS_DOCTOR, "--seconds", "0.1", "--domain", std::to_string(domain.first()), "--json"}};
  const std::optional<int> status = doctor.wait();
  const nlohmann::json output = nlohmann::json::parse(doctor.output());
  bool has_fault = false;
  for (const auto& finding : output.at("findings")) {
    has_fault = has_fault || finding.at("severity") == "fault";
    EXPECT_EQ(finding.at("remedy").get<std::string>().empty(), finding.at("severity") == "good") << finding;
  }
  EXPECT_EQ(status, has_fault ? 1 : 0) << doctor.output();
}

TEST(DoctorProgram, ReportsASilentDiscoveryServer) {
  e2e::Process doctor{{TACTUS_DOCTOR, "--seconds", "0.1", "--discovery-server", "127.0.0.1:9"}};
  EXPECT_EQ(doctor.wait(), 1);
  EXPECT_THAT(doctor.output(), HasSubstr("did not find each other through 127.0.0.1:9"));
}

TEST(DoctorProgram, FailsIfItsOutputCannotBeWritten) {
  e2e::Process doctor{{"/bin/sh", "-c", "exec \"$0\" --vulnerabilities > /dev/full", TACTUS_DOCTOR}};
  EXPECT_EQ(doctor.wait(), 1);
  EXPECT_THAT(doctor.output(), HasSubstr("cannot write the output: No space left on device"));
}

TEST(DoctorProgram, RefusesWrongInput) {
  for (const char* option : {"--domain=99", "--qos=/nowhere", "--seconds=0", "--priority=99"}) {
    e2e::Process doctor{{TACTUS_DOCTOR, option}};
    EXPECT_EQ(doctor.wait(), 2) << option << doctor.output();
  }
}

}  // namespace
}  // namespace tactus::doctor
