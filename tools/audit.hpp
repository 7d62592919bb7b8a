/// Checks a contact log against the original model: was every contact that an HRTC called exact the true one?
///
/// Knows the original triangles and the log, nothing of how either came about: other geometry, other search, extended
/// precision. Contacts are compared as sets of triangle keys and by depth. A triangle whose distance is within
/// kTangent of the radius may be in the set or not; it is counted. FCL is asked the same of the same triangles for
/// every audited entry: it has no say in what is a mismatch, but where it disagrees the audit itself is in doubt.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "spm/model.hpp"
#include "tools/second_opinion.hpp"
#include "tools/surface_grid.hpp"
#include "trace/contact_log.hpp"

namespace tactus::tools {

/// A log or model that cannot be audited: says what, where, what was found and what was expected.
class AuditError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline constexpr double kTangent = 1e-6;          ///< metres; also the tolerance of depths
inline constexpr std::uint32_t kNearChange = 10;  ///< cycles: an entry this soon after a region change is near it

struct AuditOptions {
  std::uint32_t cycles = 10000;  ///< audited at most, of each object
};

/// What is true of an object.
struct Original {
  std::string name;                 ///< of the file, without folder and extension
  std::vector<Corners> triangles;   ///< cleaned, not empty
  std::optional<spm::Model> model;  ///< borrowed; for what the true paths needed
};

/// An audited entry that does not agree with the original.
struct Mismatch {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> missing;  ///< keys of touched triangles that the log lacks
  std::vector<std::uint64_t> extra;    ///< keys in the log that are not touched, or logged too often
  struct Depth {
    std::uint64_t triangle;
    double logged, expected;  ///< metres
  };
  std::vector<Depth> depths;
};

/// An audited entry of which FCL thinks otherwise than the audit.
struct Disagreement {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> only_audit, only_fcl;  ///< keys of triangles that one alone says are touched
  struct Distance {
    std::optional<double> audit;  ///< metres; none when further than the radius
    double fcl;                   ///< metres
  };
  std::optional<Distance> distance;  ///< of the nearest triangle, where they differ
};

/// What FCL says to the audited entries.
struct SecondOpinions {
  static constexpr std::size_t kKept = 5;
  std::uint64_t requested = 0;
  std::uint64_t tangent = 0;  ///< triangles on which the two differ within kTangent of the radius
  std::uint64_t disagreed = 0;
  std::vector<Disagreement> first;  ///< the first kKept
};

/// From touching the original surface to feeling it as it is.
struct FirstTouch {
  std::uint32_t probe;
  std::int64_t touch_ns;                 ///< first entry that touches the original
  std::optional<std::int64_t> exact_ns;  ///< first exact entry that does
};

/// What the true paths needed and what the HRTC loaded, in records.
struct RecordsUse {
  std::uint64_t needed;    ///< union of the closed lists of all cells that a ball in contact met
  std::uint64_t of_model;  ///< all that the model has
  std::optional<std::uint64_t> received, returned;  ///< from the log's totals; none when the HRTC was killed
};

struct ObjectAudit {
  static constexpr std::size_t kMismatchesKept = 5;
  std::string name;
  std::uint32_t index = 0;
  std::uint64_t entries = 0;        ///< logged near the object
  std::uint64_t contact = 0;        ///< of these, with the original surface within the radius
  std::uint64_t exact_contact = 0;  ///< of these, flagged exact
  std::uint64_t truncated = 0;      ///< exact ones with more contacts than an entry holds: not audited
  std::uint64_t audited = 0;
  std::uint64_t audited_near_change = 0;
  std::uint64_t triangles = 0;  ///< compared in all audited entries
  std::uint64_t tangent = 0;    ///< triangles excepted for tangency in audited entries
  std::uint64_t mismatched = 0;
  std::vector<Mismatch> mismatches;  ///< the first kMismatchesKept
  SecondOpinions second;
  std::vector<FirstTouch> touches;  ///< by probe
  std::optional<RecordsUse> records;
};

struct AuditReport {
  std::string log;  ///< name of the file, without folder and extension
  std::string original;
  std::uint64_t original_triangles = 0;
  std::vector<std::string> logged_objects;  ///< names of all objects in the log
  bool torn = false;                        ///< the log ends within an entry
  bool unfinished = false;                  ///< no totals for an object: its HRTC did not end by itself
  std::uint64_t undeclared = 0;             ///< entries of objects that the log does not name
  std::vector<ObjectAudit> objects;         ///< those that were matched to the original

  /// No mismatch, and no disagreement with FCL.
  [[nodiscard]] bool clean() const noexcept;
};

/// A whole log in memory, about 100 bytes and 16 for each contact of an entry.
struct ContactLog {
  struct Entry {
    std::int64_t time_ns;
    Point centre;
    double radius;
    std::uint64_t first_contact;
    std::uint32_t contact_count;
    std::uint32_t object, probe, since_change;
    bool exact, truncated;
  };
  std::vector<trace::LoggedObject> objects;
  std::vector<Entry> entries;
  std::vector<trace::LoggedContact> contacts;
  std::vector<trace::LoggedTotals> totals;
  bool torn = false;
};
/// Throws LogError (missing, not a log, later version) or AuditError naming the entry with a ball or scale that no HRTC
/// can have logged.
[[nodiscard]] ContactLog read_log(const std::filesystem::path& path);

/// Which entries are looked at, ascending: of `near_change.size()` candidates up to `most`, first those near a region
/// change, up to 40 % of `most` evenly spread, then the others, evenly; when these are too few, more of the first.
[[nodiscard]] std::vector<std::size_t> choose_entries(const std::vector<bool>& near_change, std::size_t max);

/// Audits the objects of `log` with the digest of `original.model`; without one, those with its name, or the only one.
/// `second` is asked about `original.triangles`.
[[nodiscard]] AuditReport audit(const ContactLog& log, const Original& original, SecondOpinion& second,
                                const AuditOptions& options);

/// Audits `log` against `model`, a mesh (imported and cleaned) or an .spm file (its finest faces). `spm`, which may be
/// empty, is the .spm file of a mesh. Throws what reading them throws.
[[nodiscard]] AuditReport audit_files(const std::filesystem::path& log, const std::filesystem::path& model,
                                      const std::filesystem::path& spm, const AuditOptions& options);

}  // namespace tactus::tools
