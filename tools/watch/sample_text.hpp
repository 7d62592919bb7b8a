/// Decodes samples for people and scripts: ids become names, and the numbers of status bits become their names.
///
/// No DDS, thread or clock. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>

#include "trace/idl_schema.hpp"

namespace tactus::watch {

/// A decoded sample: an object with the fields of its IDL type, in their order.
using Fields = nlohmann::ordered_json;

/// The samples that are printed. An empty name selects all.
struct SampleFilter {
  std::string user;  ///< samples of this user
  std::string from;  ///< samples that this participant sent
};

class SampleReader {
 public:
  /// `idl`: the text with all types. Throws SchemaError.
  explicit SampleReader(const std::string& idl) : schema_{idl} {}

  /// Decodes a sample. Ids and hashes are still numbers. Throws SchemaError if the sample does not match `type`.
  [[nodiscard]] Fields decode(const std::string& type, std::span<const std::uint8_t> encoded) const;

  /// Adds a name that `name` can use for its id. Stores a limited number of names.
  void add_name(const std::string& name);
  /// Adds all names in a roster or catalogue entry.
  void add_names(const Fields& entry);

  /// Replaces the numbers that people cannot read. An id becomes its name; if no sample has contained the name yet, 16
  /// hexadecimal digits; the id 0 becomes null. A hash becomes 16 hexadecimal digits. `status` becomes a list of
  /// names, followed by `fault_reason` in the case of a fault. The figures of metrics become one object.
  void name(Fields& fields) const;

  /// Returns whether `filter` selects a sample of which `name` has not changed the ids.
  [[nodiscard]] static bool is_selected(const Fields& fields, const SampleFilter& filter);
  /// Returns an error text if samples of `type` do not have the fields that `filter` needs.
  [[nodiscard]] std::optional<std::string> refusal(const std::string& type, const SampleFilter& filter) const;

 private:
  trace::IdlSchema schema_;
  std::map<std::uint64_t, std::string> names_;  // by id
};

/// Returns a sample as lines `FIELD: VALUE`, where `a.b` is field b of struct a. Omits the end of long lists.
[[nodiscard]] std::string text(const Fields& fields);

/// Returns a sample as JSON on one line.
[[nodiscard]] std::string json_line(const Fields& fields);

}  // namespace tactus::watch
