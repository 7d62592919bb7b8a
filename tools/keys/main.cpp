// tactus-keys: makes, lists and revokes the keys of a secured session.
#include <CLI/CLI.hpp>
#include <ctime>
#include <exception>
#include <filesystem>
#include <functional>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "keys/authority.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"

namespace {

using namespace tactus;
namespace fs = std::filesystem;

constexpr char kExamples[] = R"(
Examples:
  tactus-keys init lab-keys                          a new authority; keep this folder on one machine
  tactus-keys add-host lab-keys museum               a host named museum
  tactus-keys add-hrtc lab-keys desk ann bob         an HRTC named desk that serves only ann and bob
  tactus-keys add-user lab-keys laptop ann bob       a program named laptop that brings the users ann and bob
  tactus-keys export lab-keys desk desk-keys         a copy for the machine of desk
  tactus-hrtc --session lab --name desk --keys desk-keys

All programs of a session need keys of one authority. All samples are encrypted, and others cannot join.
Exit status: 0 done, 1 done, but the output could not be written, 2 wrong input.)";

const char* purpose_of(keys::Role role) {
  switch (role) {
    case keys::Role::kHost:
      return "Make the keys of a VE host: it serves all objects, or only the named ones";
    case keys::Role::kHrtc:
      return "Make the keys of an HRTC: it computes the forces of all users, or only of the named ones";
    case keys::Role::kUser:
      return "Make the keys of a program that brings users: it moves the hands of these users only";
    case keys::Role::kOperator:
      return "Make the keys of an operator, who may also reset forces and end the session";
    case keys::Role::kObserver:
      return "Make the keys of an observer, who reads everything and can stop the forces";
    case keys::Role::kTester:
      return "Make the keys of tactus latency: it writes everything, but only in sessions of its own";
  }
  return "";
}

/// The argument that names the users or objects of this role; null if it has none.
const char* names_of(keys::Role role) {
  switch (role) {
    case keys::Role::kHost:
      return "OBJECT";
    case keys::Role::kHrtc:
    case keys::Role::kUser:
    case keys::Role::kOperator:
      return "USER";
    case keys::Role::kObserver:
    case keys::Role::kTester:
      break;
  }
  return nullptr;
}
/// Whether the role is for all users or objects if none is named.
bool is_for_all(keys::Role role) { return role == keys::Role::kHost || role == keys::Role::kHrtc; }

std::string permitted_text(const keys::Member& member) {
  if (!member.permitted.empty()) return keys::text_of(member.permitted);
  if (!is_for_all(member.role)) return "";
  return member.role == keys::Role::kHost ? "all objects" : "all users";
}

void show(const keys::Authority& authority) {
  const std::time_t now = std::time(nullptr);
  std::printf("%-24s %-9s %-11s %-8s %s\n", "name", "role", "valid until", "state", "users or objects");
  std::string error;  // of the first member whose certificate cannot be read
  for (const std::string& name : authority.names()) {
    try {
      const std::optional<keys::Member> member = authority.find(name);
      if (!member) continue;
      const char* state = "valid";
      if (member->is_revoked)
        state = "revoked";
      else if (now > member->valid_until)
        state = "expired";
      std::printf("%-24s %-9s %-11s %-8s %s\n", session::printable(name).c_str(),
                  std::string{name_of(member->role)}.c_str(), keys::utc_text(member->valid_until, "%Y-%m-%d").c_str(),
                  state, session::printable(permitted_text(*member)).c_str());
    } catch (const keys::KeyError& found) {
      std::printf("%-24s %-9s %-11s %-8s\n", session::printable(name).c_str(), "?", "?", "damaged");
      if (error.empty()) error = found.what();
    }
  }
  std::printf("%s. The authority and all keys expire on %s at the latest.\n",
              session::printable(keys::text_of(authority.revoked())).c_str(),
              keys::utc_text(authority.valid_until(), "%Y-%m-%d").c_str());
  if (const std::string warning = keys::clock_warning(authority.revoked(), now); !warning.empty())
    std::printf("%s\n", warning.c_str());
  if (!error.empty()) throw keys::KeyError(error);
}

/// Returns the keys that new ones of this name replace; none if there are none, or if their certificate is missing or
/// cannot be read and the new ones state their names. Throws KeyError otherwise.
std::optional<keys::Member> earlier_keys(const keys::Authority& authority, const keys::NewMember& member,
                                         bool for_all) {
  std::string reason = "the certificate of " + member.name + " is missing";
  try {
    std::optional<keys::Member> earlier = authority.find(member.name);
    if (earlier || !fs::exists(authority.folder_of(member.name))) return earlier;
  } catch (const keys::KeyError& error) {
    if (!member.replaces) throw;
    reason = error.what();
  }
  const char* const names = names_of(member.role);
  if (member.replaces && names != nullptr && member.permitted.empty() && !for_all)
    throw keys::KeyError(reason + "; found no " + names + ", expected names" +
                         (is_for_all(member.role) ? " or --all" : "") +
                         ", because those of the earlier keys are unknown");
  return std::nullopt;
}

/// Throws KeyError if a member has keys of another role that are not revoked: a wrong command would revoke them.
void check_role(const std::optional<keys::Member>& earlier, keys::Role role) {
  if (!earlier || earlier->role == role || earlier->is_revoked) return;
  const std::string name{name_of(earlier->role)};
  throw keys::KeyError(earlier->name + ": has the keys of role " + name + ", expected add-" + name +
                       " or another name; to change the role, revoke these keys first");
}

/// `which`: begin of the message, such as "The keys of desk".
void print_revoked(const fs::path& authority, const std::string& which) {
  std::printf(
      "%s are revoked. Copy revoked.pem from %s to the folders of keys on the other machines.\n"
      "Running programs read it within 5 s, and then refuse all messages of these keys.\n",
      which.c_str(), (authority / "authority").c_str());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Keys of a secured session: makes, lists and revokes them.", "tactus-keys"};
  app.footer(kExamples);
  app.require_subcommand(1);
  fs::path folder, to;
  std::string name;
  keys::NewMember member;
  bool for_all = false;
  std::function<void()> action;
  const auto command = [&](const std::string& what, const std::string& purpose, std::function<void()> run) {
    CLI::App* const added = app.add_subcommand(what, purpose);
    added->add_option("AUTHORITY", folder, "Folder of the authority")->required();
    added->callback([&action, run = std::move(run)] { action = run; });
    return added;
  };
  command("init", "Make a new authority in a new folder, whose name is the name of the authority", [&] {
    (void)keys::Authority::create(folder);
    std::printf("%s is a new authority. Its folder 'authority' can make keys for everyone: keep it on this machine.\n",
                folder.c_str());
  });
  for (const keys::Role role : keys::kRoles) {
    CLI::App* const add = command("add-" + std::string{name_of(role)}, purpose_of(role), [&, role] {
      member.role = role;
      const keys::Authority authority{folder};
      const std::optional<keys::Member> earlier = earlier_keys(authority, member, for_all);
      const bool had_keys = fs::exists(authority.folder_of(member.name) / keys::files::kCertificate);
      check_role(earlier, role);
      if (member.replaces && !fs::exists(authority.folder_of(member.name)))
        throw keys::KeyError("--replace: found no member '" + member.name + "', expected one of tactus keys show");
      if (member.replaces && member.permitted.empty() && !for_all && earlier && earlier->role == role)
        member.permitted = earlier->permitted;
      const fs::path made = authority.add(member);
      std::printf("%s has the keys of %s %s. Copy it to its machine, for example by tactus keys export.\n",
                  made.c_str(), std::string{name_of(role)}.c_str(), member.name.c_str());
      if (had_keys)
        print_revoked(folder, "The earlier keys of " + member.name);
      else if (member.replaces)
        std::printf(
            "Its certificate.pem was missing, so earlier keys of %s are not revoked, and can never be. They are valid "
            "until they expire.\nIf somebody may have a copy of them, make a new authority, and new keys for all "
            "members.\n",
            member.name.c_str());
    });
    add->add_option("NAME", member.name, "Name of the program in the session")->required();
    if (const char* const names = names_of(role)) {
      const char* const purpose = role == keys::Role::kHost ? "Objects that the host may offer; default: all"
                                  : role == keys::Role::kHrtc
                                      ? "Users that the HRTC may serve; default: all"
                                      : "Users that the program may bring; default: one named NAME";
      CLI::Option* const named = add->add_option(names, member.permitted, purpose);
      if (is_for_all(role))
        add->add_flag("--all", for_all, "With --replace: do not keep the earlier names")->excludes(named);
    }
    add->add_option("--days", member.days, "Days for which the keys are valid")
        ->capture_default_str()
        ->check(CLI::Range(1, keys::kMaxDays));
    add->add_flag(
        "--replace", member.replaces,
        names_of(role) == nullptr
            ? "Revoke earlier keys of this name"
            : "Revoke earlier keys of this name. The new ones keep their USER or OBJECT names unless you give names");
  }
  command("revoke", "Revoke the keys of a member",
          [&] {
            const keys::Authority authority{folder};
            authority.revoke(name);
            print_revoked(folder, "The keys of " + name);
          })
      ->add_option("NAME", name, "Name of the member")
      ->required();
  command("show", "List the members", [&] { show(keys::Authority{folder}); });
  CLI::App* const exported = command("export", "Copy the folder of a member, for its machine",
                                     [&] { keys::Authority{folder}.export_member(name, to); });
  exported->add_option("NAME", name, "Name of the member")->required();
  exported->add_option("TO", to, "New folder")->required();
  try {
    app.parse(argc, argv);
    action();
    return realtime::status_after_output("tactus-keys");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const fs::filesystem_error& error) {
    std::cerr << "tactus-keys: " << error.path1().string()
              << (error.path2().empty() ? "" : " to " + error.path2().string()) << ": " << error.code().message()
              << '\n';
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "tactus-keys: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
