// Recordings (MCAP files with CDR samples and their IDL) as structured arrays.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "session/messages.hpp"
#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"

namespace tactus::python {
namespace {

using trace::IdlType;
using trace::SchemaError;

/// Reads numbers of a sample in order, with the alignment of CDR.
class SampleReader {
 public:
  explicit SampleReader(std::span<const std::uint8_t> encoded) : bytes_{encoded} {
    if (bytes_.size() < kHeadBytes || bytes_[0] != 0 || bytes_[1] > 1)
      throw SchemaError("sample: found another encoding, expected plain CDR");
    swaps_ = bytes_[1] == 0;
  }
  /// Copies `count` numbers of `size` bytes. `path` names the field in an error.
  void copy(std::size_t size, std::size_t count, const std::string& path, std::uint8_t* to) {
    at_ = kHeadBytes + (at_ - kHeadBytes + size - 1) / size * size;
    if (at_ > bytes_.size() || count > (bytes_.size() - at_) / size) fail(path);
    std::memcpy(to, bytes_.data() + at_, size * count);
    if (swaps_)
      for (std::size_t i = 0; i < count; ++i) std::reverse(to + i * size, to + (i + 1) * size);
    at_ += size * count;
  }
  [[nodiscard]] std::uint32_t number(const std::string& path) {
    std::uint32_t value;
    copy(sizeof value, 1, path, reinterpret_cast<std::uint8_t*>(&value));
    return value;
  }
  /// Reads the number of elements of a sequence. `min_bytes`: smallest size of an element, at least 1.
  [[nodiscard]] std::uint32_t count(std::size_t min_bytes, const std::string& path) {
    const std::uint32_t elements = number(path);
    if (elements > (bytes_.size() - at_) / min_bytes) fail(path);
    return elements;
  }
  [[nodiscard]] std::string text(const std::string& path) {
    const std::uint32_t size = count(1, path);  // with its terminating zero
    if (size == 0) fail(path);
    const std::string value(reinterpret_cast<const char*>(bytes_.data() + at_), size - 1);
    at_ += size;
    return value;
  }

 private:
  static constexpr std::size_t kHeadBytes = 4;  // the encapsulation; fields are aligned relative to its end
  [[noreturn]] static void fail(const std::string& path) { throw SchemaError("sample ends inside field " + path); }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = kHeadBytes;
  bool swaps_ = false;  // the sample is big-endian
};

/// The structured array of an IDL type, and the steps that decode a sample into a row of it. A text, an enumerator and
/// a sequence are Python objects. A sequence is an array of its own.
class Layout {
 public:
  /// `head`: bytes of the fields before those of the type.
  Layout(const IdlType& type, std::size_t head) {
    const Placed placed = add(type, head, "");
    type_ = placed.type;
    bytes_ = head + placed.size;
    for (const Step& step : steps_) min_encoded_bytes_ += step.size * step.count;
    for (const auto& [name, field] : placed.fields) fields_.push_back({name, field});
  }

  struct Member {
    std::string name;
    std::pair<py::object, std::size_t> field;  // type and offset
  };
  [[nodiscard]] const py::object& type() const noexcept { return type_; }
  [[nodiscard]] const std::vector<Member>& fields() const noexcept { return fields_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] bool has_objects() const noexcept { return has_objects_; }

  /// Decodes a sample into a row. If the row has objects, the caller holds the interpreter's lock.
  void decode(SampleReader& sample, std::uint8_t* row) const {
    for (const Step& step : steps_) {
      std::uint8_t* const to = row + step.offset;
      switch (step.kind) {
        case IdlType::Kind::kText:
          put(to, py::str(py::bytes(sample.text(step.path)).attr("decode")("utf-8", "replace")));
          break;
        case IdlType::Kind::kEnum: {
          const std::uint32_t value = sample.number(step.path);
          put(to, value < step.names.size() ? step.names[value] : py::str(std::to_string(value)));
          break;
        }
        case IdlType::Kind::kSequence:
          put(to, sequence(*step.element, step.path, sample));
          break;
        default:
          sample.copy(step.size, step.count, step.path, to);
      }
    }
  }

 private:
  struct Step {
    IdlType::Kind kind;
    std::size_t offset;
    std::string path;
    std::size_t size = 4, count = 1;             // of numbers; otherwise of the number at the begin of the field
    std::vector<py::str> names = {};             // of the enumerators
    std::shared_ptr<const Layout> element = {};  // of a sequence
  };
  struct Placed {
    py::object type;
    std::size_t size, alignment;
    std::vector<std::pair<std::string, std::pair<py::object, std::size_t>>> fields = {};  // of a struct
  };
  static constexpr std::size_t kObjectBytes = sizeof(void*);  // of a reference to a Python object

  Placed add(const IdlType& type, std::size_t offset, const std::string& path) {
    switch (type.kind) {
      case IdlType::Kind::kNumber: {
        const auto [format, size] = kNumbers[static_cast<std::size_t>(type.number)];
        steps_.push_back({type.kind, offset, path, size});
        return {py::dtype{format}, size, size};
      }
      case IdlType::Kind::kArray:
        return add_array(type, offset, path);
      case IdlType::Kind::kStruct:
        return add_struct(type, offset, path);
      default:
        break;
    }
    has_objects_ = true;
    Step step{type.kind, offset, path};
    for (const std::string& name : type.names) step.names.emplace_back(name);
    if (type.kind == IdlType::Kind::kSequence) step.element = std::make_shared<const Layout>(*type.of, 0);
    steps_.push_back(std::move(step));
    return {py::dtype{"O"}, kObjectBytes, kObjectBytes};
  }
  Placed add_array(const IdlType& type, std::size_t offset, const std::string& path) {
    const std::size_t first = steps_.size();
    const Placed element = add(*type.of, offset, path);
    if (type.of->kind == IdlType::Kind::kNumber) {
      steps_[first].count = type.count;
    } else {
      for (std::size_t i = 1; i < type.count; ++i) (void)add(*type.of, offset + i * element.size, path);
    }
    return {py::dtype::from_args(py::make_tuple(element.type, type.count)), element.size * type.count,
            element.alignment};
  }
  Placed add_struct(const IdlType& type, std::size_t offset, const std::string& path) {
    Placed placed{{}, 0, 1};
    py::list names, formats, offsets;
    for (const IdlType::Member& member : type.members) {
      const std::size_t alignment = alignment_of(*member.type);
      placed.size = (placed.size + alignment - 1) / alignment * alignment;
      const Placed field =
          add(*member.type, offset + placed.size, path.empty() ? member.name : path + "." + member.name);
      names.append(member.name);
      formats.append(field.type);
      offsets.append(placed.size);
      placed.fields.push_back({member.name, {field.type, placed.size}});
      placed.size += field.size;
      placed.alignment = std::max(placed.alignment, alignment);
    }
    placed.size = (placed.size + placed.alignment - 1) / placed.alignment * placed.alignment;
    placed.type = py::dtype{names, formats, offsets, static_cast<py::ssize_t>(placed.size)};
    return placed;
  }
  [[nodiscard]] static std::size_t alignment_of(const IdlType& type) {
    std::size_t alignment = 1;
    switch (type.kind) {
      case IdlType::Kind::kNumber:
        return kNumbers[static_cast<std::size_t>(type.number)].second;
      case IdlType::Kind::kArray:
        return alignment_of(*type.of);
      case IdlType::Kind::kStruct:
        for (const IdlType::Member& member : type.members) alignment = std::max(alignment, alignment_of(*member.type));
        return alignment;
      default:
        return kObjectBytes;
    }
  }

  [[nodiscard]] static py::object sequence(const Layout& element, const std::string& path, SampleReader& sample) {
    const std::uint32_t count = sample.count(element.min_encoded_bytes_, path);
    py::array values = empty_array(count, element.type());
    auto* const first = static_cast<std::uint8_t*>(values.mutable_data());
    const Step& step = element.steps_.front();
    if (element.steps_.size() == 1 && step.kind == IdlType::Kind::kNumber && count > 0) {
      sample.copy(step.size, count * step.count, path, first);  // all at once, because there may be a megabyte
      return values;
    }
    for (std::uint32_t i = 0; i < count; ++i) element.decode(sample, first + i * element.bytes());
    return values;
  }
  /// Replaces the object in a field of a row.
  static void put(std::uint8_t* field, py::object value) {
    PyObject* before;
    std::memcpy(&before, field, kObjectBytes);
    PyObject* const after = value.release().ptr();
    std::memcpy(field, &after, kObjectBytes);
    Py_XDECREF(before);
  }

 public:
  /// An array of `type` whose objects are None.
  [[nodiscard]] static py::array empty_array(std::size_t count, const py::object& type) {
    return py::module_::import("numpy").attr("empty")(count, type);
  }

 private:
  static constexpr std::array<std::pair<const char*, std::size_t>, 10> kNumbers{
      {{"?", 1}, {"u1", 1}, {"i2", 2}, {"u2", 2}, {"i4", 4}, {"u4", 4}, {"i8", 8}, {"u8", 8}, {"f4", 4}, {"f8", 8}}};

  py::object type_;
  std::vector<Member> fields_;  // of a struct
  std::size_t bytes_ = 0;
  std::size_t min_encoded_bytes_ = 0;  // of a sample
  std::vector<Step> steps_;            // at least one
  bool has_objects_ = false;
};

/// A recording. Reads the file when it is opened, and again for each topic, so that only one topic needs memory.
class Recording {
 public:
  explicit Recording(std::filesystem::path path) : path_{std::move(path)} {
    const py::gil_scoped_release no_gil;
    trace::McapReader reader{path_};
    trace::McapMessage message;
    std::map<std::uint16_t, std::string> topics;
    std::map<std::uint16_t, Topic> channels;
    while (reader.next(message)) {
      const auto [channel, is_new] = channels.try_emplace(message.channel);
      if (is_new) {
        topics[message.channel] = message.topic;
        if (message.schema_encoding != "omgidl")
          throw SchemaError(path_.string() + ", topic " + message.topic + ": found schema encoding " +
                            message.schema_encoding + ", expected omgidl");
        const auto [schema, is_new_text] = schemas_.try_emplace(*message.schema_text);
        if (is_new_text) schema->second = std::make_shared<const trace::IdlSchema>(*message.schema_text);
        channel->second = {message.channel, 0, message.schema, schema->second};
      }
      ++channel->second.messages;
    }
    // The second channel of a topic has full-rate probe states. `tactus record --to-csv` gives the same names.
    for (const auto& [channel, name] : trace::channel_names(topics)) topics_[name] = channels[channel];
    is_truncated_ = reader.is_truncated();
  }

  [[nodiscard]] py::array rows(const std::string& name) const {
    const auto found = topics_.find(name);
    if (found == topics_.end()) {
      std::string known;
      for (const auto& [topic, of] : topics_) known += (known.empty() ? "" : ", ") + topic;
      throw py::key_error("found no topic " + name + " in " + path_.string() + ", expected one of " + known);
    }
    const Topic& topic = found->second;
    const Layout layout{topic.schema->type(topic.type), kHeadBytes};
    py::list names, formats, offsets;
    names.append("log_time_ns"), formats.append("i8"), offsets.append(0);
    names.append("sequence"), formats.append("u4"), offsets.append(sizeof(std::int64_t));
    for (const Layout::Member& member : layout.fields()) {
      names.append(member.name);
      formats.append(member.field.first);
      offsets.append(kHeadBytes + member.field.second);
    }
    py::array rows = Layout::empty_array(topic.messages,
                                         py::dtype{names, formats, offsets, static_cast<py::ssize_t>(layout.bytes())});
    std::optional<py::gil_scoped_release> no_gil;
    auto* const first = static_cast<std::uint8_t*>(rows.mutable_data());
    if (!layout.has_objects()) no_gil.emplace();
    trace::McapReader reader{path_};
    trace::McapMessage message;
    std::size_t count = 0;
    while (count < topic.messages && reader.next(message)) {
      if (message.channel != topic.channel) continue;
      std::uint8_t* const row = first + count++ * layout.bytes();
      const auto time = static_cast<std::int64_t>(message.log_time);
      std::memcpy(row, &time, sizeof time);
      std::memcpy(row + sizeof time, &message.sequence, sizeof message.sequence);
      SampleReader sample{{message.bytes.data(), message.bytes.size()}};
      layout.decode(sample, row);
    }
    if (count < topic.messages)
      throw trace::McapError(path_.string() + ": found fewer messages than when it was opened");
    no_gil.reset();
    return rows;
  }

  [[nodiscard]] std::map<std::string, std::size_t> topics() const {
    std::map<std::string, std::size_t> counts;
    for (const auto& [name, topic] : topics_) counts[name] = topic.messages;
    return counts;
  }
  [[nodiscard]] bool is_truncated() const noexcept { return is_truncated_; }

 private:
  static constexpr std::size_t kHeadBytes = 16;  // time and sequence number of a row, and 4 bytes of alignment
  struct Topic {
    std::uint16_t channel = 0;
    std::size_t messages = 0;
    std::string type;
    std::shared_ptr<const trace::IdlSchema> schema;
  };
  std::filesystem::path path_;
  std::map<std::string, std::shared_ptr<const trace::IdlSchema>> schemas_;  // by text
  std::map<std::string, Topic> topics_;
  bool is_truncated_ = false;
};

}  // namespace

void add_recording(py::module_& module) {
  py::class_<Recording>(module, "Recording",
                        "A recording of `tactus record`, or a flight recording: a structured array for each topic.\n\n"
                        "    states = Recording(\"lab.mcap\")[\"tactus_probe_state\"]\n"
                        "    states[\"force\"], states[\"device\"][\"position\"]")
      .def(py::init<std::filesystem::path>(), py::arg("path"),
           "Reads the file from front to end. It may be the truncated file of a killed recorder. Raises McapError for\n"
           "a damaged file, and SchemaError for types that the package cannot read.")
      .def("__getitem__", &Recording::rows, py::arg("topic"),
           "Reads a topic: a structured array with a row for each sample.\n\n"
           "Its fields are log_time_ns (arrival, ns since 1970), sequence, and those of the IDL type. A text or an\n"
           "enumerator is a str, and a sequence is an array of its own. Raises KeyError for an unknown topic.")
      .def(
          "__contains__",
          [](const Recording& self, const std::string& topic) { return self.topics().count(topic) > 0; },
          py::arg("topic"))
      .def("__iter__", [](const Recording& self) { return py::iter(py::cast(self.topics())); })
      .def("__len__", [](const Recording& self) { return self.topics().size(); })
      .def(
          "keys", [](const Recording& self) { return py::list(py::cast(self.topics())); }, "The names of the topics.")
      .def_property_readonly("topics", &Recording::topics,
                             "The topics with their numbers of samples. The second channel of a topic has the suffix "
                             "-2.")
      .def_property_readonly("truncated", &Recording::is_truncated,
                             "True if the file has no end, because its recorder was killed.");
  module.def("id_of", &session::id_of, py::arg("name"),
             "The id of a participant, user, object or session in samples, such as ProbeState.user_id.");
}

}  // namespace tactus::python
