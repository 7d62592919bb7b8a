/// Decodes encoded samples by the text of their IDL, without generated code.
///
/// Supports the part of OMG IDL that tactus.idl uses: modules, constants, typedefs, arrays, enumerations, structs,
/// strings and sequences. Skips annotations. The samples are plain CDR (XCDR version 1) of either byte order, with
/// their encapsulation. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::trace {

/// Thrown for unusable IDL text or samples. The message names the line of the text or the field of the sample.
class SchemaError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Returns whether two IDL texts differ at most in comments and blanks.
[[nodiscard]] bool has_same_types(const std::string& idl, const std::string& other);

class IdlSchema {
 public:
  /// Parses IDL text. Throws SchemaError that names line, text found and text expected.
  explicit IdlSchema(const std::string& text);
  ~IdlSchema();

  /// Returns the columns of a table of samples of `type`, for example "tactus::idl::ProbeState". Each number, string
  /// and enumerator has a column: `a.b` is field b of struct a, and `a.0` the first element of array a. A sequence has
  /// a single column. Throws SchemaError if the type is unknown.
  [[nodiscard]] std::vector<std::string> columns(const std::string& type) const;

  /// Returns the values of a sample, one for each column. A number has as many digits as are needed to restore it; an
  /// enumerator has its name; a sequence is JSON. Throws SchemaError if the sample does not match the type.
  [[nodiscard]] std::vector<std::string> values(const std::string& type, std::span<const std::uint8_t> encoded) const;

  /// Returns a sample as one JSON object with the fields of its type. Numbers and enumerators are as in `values`, but a
  /// number that is not finite is the string "nan", "inf" or "-inf", because JSON has no such numbers. Bytes of strings
  /// that are not UTF-8 remain as they are. Throws SchemaError like `values`.
  [[nodiscard]] std::string json(const std::string& type, std::span<const std::uint8_t> encoded) const;

 private:
  struct Type;
  class Parser;
  class Decoder;
  [[nodiscard]] const Type& find(const std::string& type) const;

  std::map<std::string, std::shared_ptr<const Type>> structs_;  // by full name
};

}  // namespace tactus::trace
