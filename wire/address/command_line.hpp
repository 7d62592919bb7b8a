/// Adds the command-line options that all programs of a session have. Header only, for a `main` that uses CLI11.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "wire/address/address.hpp"

namespace tactus::wire {

/// Adds --peer and --discovery-server.
inline void add_discovery_options(CLI::App& app, Discovery& discovery) {
  CLI::Option* const peers =
      app.add_option("--peer", discovery.peers, "Discover other programs at this HOST, not by multicast; repeatable")
          ->delimiter(',')
          ->allow_extra_args(false)  // the next argument may be a model
          ->type_name("HOST");
  app.add_option("--discovery-server", discovery.servers,
                 "Discover other programs through this Fast DDS discovery server, default port 11811; repeatable")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("HOST[:PORT]")
      ->excludes(peers);
}

/// Adds --keys. `purpose`: for the help text.
inline CLI::Option* add_keys_option(CLI::App& app, std::filesystem::path& keys, const std::string& purpose) {
  const auto is_named = [](const std::string& text) {  // an empty variable of a script must not mean 'no keys'
    return text.empty() ? std::string{"found no name, expected a folder of tactus keys"} : std::string{};
  };
  return app.add_option("--keys", keys, purpose)->check(is_named, "")->type_name("DIR");
}

/// Adds --session, --name, --domain, --qos, --keys, --plain, --audit and the options of discovery. `address` contains
/// the defaults; the help text calls the program `who`.
inline void add_address_options(CLI::App& app, SessionAddress& address, const std::string& who) {
  app.add_option("--session", address.session, "Session to join")->capture_default_str();
  app.add_option("--name", address.participant,
                 "Name of this " + who + ", unique in the session; with --keys, that of the keys")
      ->capture_default_str()
      ->each([&address](const std::string&) { address.naming = Naming::kGiven; });
  app.add_option("--domain", address.domain, "First of the three DDS domains that the session uses")
      ->capture_default_str();
  add_discovery_options(app, address.discovery);
  app.add_option("--qos", address.qos, "Directory of the QoS profiles")->capture_default_str();
  add_keys_option(app, address.keys,
                  "Folder of this program's keys, of tactus keys; default: no encryption, and only this machine");
  app.add_flag("--plain", address.plain,
               "Without --keys: also take part with programs of other machines, without encryption");
  app.add_option("--audit", address.audit, "File of the audit log; default: in ~/.local/state/tactus/audit")
      ->type_name("FILE");
}

}  // namespace tactus::wire
