/// Reads samples by the text of their IDL, as a recording carries it: no code per type.
///
/// The part of OMG IDL that tactus.idl uses: modules, constants, typedefs, arrays, enumerations, structs, bounded
/// strings and sequences; annotations are skipped. Encoding: plain CDR (XCDR version 1) of either byte order, with its
/// encapsulation. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "spm/span.hpp"

namespace tactus::trace {

/// The text says where; a sample's error names the field.
class SchemaError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class IdlSchema {
 public:
  /// Throws SchemaError with the line, what was found and what was expected.
  explicit IdlSchema(const std::string& text);
  ~IdlSchema();

  /// One name for each number or text of a sample of `type` ("tactus::idl::ProbeState"): fields of structs as `a.b`,
  /// elements of arrays as `a.0`; a sequence is one. Throws SchemaError for an unknown type.
  [[nodiscard]] std::vector<std::string> columns(const std::string& type) const;

  /// What a sample has in these columns. Numbers in as many digits as they need to be read back the same, enumerators
  /// by name, a sequence as JSON. Throws SchemaError when the sample is not of the type.
  [[nodiscard]] std::vector<std::string> cells(const std::string& type, spm::Span<const std::uint8_t> encoded) const;

 private:
  struct Type;
  class Parser;
  class Decoder;
  std::map<std::string, std::shared_ptr<const Type>> types_;  // structs, by full name
};

}  // namespace tactus::trace
