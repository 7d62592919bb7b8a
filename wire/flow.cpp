#include "wire/flow.hpp"

#include <string>

#include "yaml/reader.hpp"

namespace tactus::wire {

Flow read_flow(const std::filesystem::path& file) try {
  const yaml::Map top{yaml::Value::load(file), {"sockets"}};
  const yaml::Map sockets{top.required("sockets"), {"session", "probe", "bulk"}};
  Flow flow;
  for (const auto& [traffic, name] :
       {std::pair{TrafficClass::kSession, "session"}, std::pair{TrafficClass::kProbe, "probe"},
        std::pair{TrafficClass::kBulk, "bulk"}}) {
    const yaml::Map marks{sockets.required(name), {"tos", "priority"}};
    SocketOptions& socket = flow.sockets[static_cast<std::size_t>(traffic)];
    for (const char* key : {"tos", "priority"}) (void)marks.required(key);
    marks.integer("tos", 0, 255, socket.tos);
    marks.integer("priority", 0, 6, socket.priority);
  }
  return flow;
} catch (const yaml::YamlError& error) {
  throw WireError(error.what());
}

}  // namespace tactus::wire
