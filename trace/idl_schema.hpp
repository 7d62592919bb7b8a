/// Decodes samples by the text of their IDL, as contained in a recording: no code per type.
///
/// Supports the part of OMG IDL that tactus.idl uses: modules, constants, typedefs, arrays, enumerations, structs,
/// bounded strings and sequences; annotations are skipped. Encoding: plain CDR (XCDR version 1) of either byte order,
/// with its encapsulation. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::trace {

/// For IDL the message has the line, for a sample the field.
class SchemaError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class IdlSchema {
 public:
  /// Throws SchemaError with line, found and expected.
  explicit IdlSchema(const std::string& text);
  ~IdlSchema();

  /// Column names of a sample of `type` ("tactus::idl::ProbeState"), one for each number or string: fields of structs
  /// as `a.b`, elements of arrays as `a.0`, a sequence as one column. Throws SchemaError for an unknown type.
  [[nodiscard]] std::vector<std::string> columns(const std::string& type) const;

  /// The cells of a sample in these columns: numbers with the digits that reproduce them, enumerators by name, a
  /// sequence as JSON. Throws SchemaError when the sample does not match the type.
  [[nodiscard]] std::vector<std::string> cells(const std::string& type, std::span<const std::uint8_t> encoded) const;

 private:
  struct Type;
  class Parser;
  class Decoder;
  std::map<std::string, std::shared_ptr<const Type>> types_;  // structs, by full name
};

}  // namespace tactus::trace
