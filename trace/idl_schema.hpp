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

/// A type of the IDL text.
struct IdlType {
  enum class Kind : std::uint8_t { kNumber, kText, kEnum, kArray, kSequence, kStruct };
  enum class Number : std::uint8_t { kBoolean, kU8, kI16, kU16, kI32, kU32, kI64, kU64, kFloat, kDouble };
  struct Member {
    std::string name;
    std::shared_ptr<const IdlType> type;
  };
  Kind kind = Kind::kNumber;
  Number number = Number::kU8;
  std::size_t count = 0;              ///< number of elements of an array
  std::shared_ptr<const IdlType> of;  ///< type of the elements of an array or sequence
  std::vector<std::string> names;     ///< names of the enumerators
  std::vector<Member> members;        ///< of a struct
  std::size_t depth = 1;              ///< number of nested types with this one, at most IdlSchema::kMaxDepth
  std::size_t values = 1;  ///< numbers, strings, sequences and enumerators in it, at most IdlSchema::kMaxValues
};

class IdlSchema {
 public:
  // The text may be that of a hostile recording.
  static constexpr std::size_t kMaxDepth = 32;            ///< of nested types, and of nested modules
  static constexpr std::size_t kMaxValues = 65'536;       ///< of a type, with those of the elements of its sequences
  static constexpr std::size_t kMaxNameBytes = 255;       ///< of a name
  static constexpr std::size_t kMaxJsonBytes = 1u << 28;  ///< of a sample or sequence as JSON

  /// Parses IDL text. Each struct has a member, and each array an element, so that a sample bounds the number of its
  /// values. Throws SchemaError that names line, text found and text expected.
  explicit IdlSchema(const std::string& text);

  /// Returns a struct by its full name, for example "tactus::idl::ProbeState". Throws SchemaError if it is unknown.
  [[nodiscard]] const IdlType& type(const std::string& name) const;

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
  class Parser;
  class Decoder;
  std::map<std::string, std::shared_ptr<const IdlType>> structs_;  // by full name
};

}  // namespace tactus::trace
