/// Checks a contact log against the original model: was every contact that an HRTC reported as exact the true one?
///
/// It uses only the original triangles and the log: other geometry code, another search, extended precision. Contacts
/// are compared as sets of triangle keys and by depth. A triangle whose distance is within kTangent of the radius may
/// be in the set or not; it is counted. FCL answers the same question for the same triangles and every audited entry.
/// It does not decide a mismatch, but where it disagrees, the audit itself is in doubt.
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

/// A log or model that cannot be audited. The message names file and item, the value found and the value expected.
class AuditError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline constexpr double kTangent = 1e-6;          ///< metres; also the tolerance of depths
inline constexpr std::uint32_t kNearChange = 10;  ///< cycles; entries within it are near a region change

struct AuditOptions {
  std::uint32_t cycles = 10000;  ///< maximum audited per object
};

/// The original of an object.
struct Original {
  std::string name;                 ///< of the file, without folder and extension
  std::vector<Corners> triangles;   ///< cleaned, not empty
  std::optional<spm::Model> model;  ///< borrowed; for the records that the paths needed
};

/// An audited entry that differs from the original.
struct Mismatch {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> missing;  ///< keys of touched triangles that the log lacks
  std::vector<std::uint64_t> extra;    ///< keys in the log that are not touched, or that are logged too often
  struct Depth {
    std::uint64_t triangle;
    double logged, expected;  ///< metres
  };
  std::vector<Depth> depths;
};

/// An audited entry where FCL differs from the audit.
struct Disagreement {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> only_audit, only_fcl;  ///< keys of triangles that only one of them reports as touched
  struct Distance {
    std::optional<double> audit;  ///< metres; none when further than the radius
    double fcl;                   ///< metres
  };
  std::optional<Distance> distance;  ///< of the nearest triangle, if they differ
};

/// FCL's answers to the audited entries.
struct SecondOpinions {
  static constexpr std::size_t kKept = 5;
  std::uint64_t requested = 0;
  std::uint64_t tangent = 0;  ///< triangles on which they differ within kTangent of the radius
  std::uint64_t disagreed = 0;
  std::vector<Disagreement> first;  ///< the first kKept
};

/// First contact of a probe with the original surface, and its first exact contact.
struct FirstTouch {
  std::uint32_t probe;
  std::int64_t touch_ns;                 ///< first entry in contact with the original
  std::optional<std::int64_t> exact_ns;  ///< first exact entry in contact with it
};

/// Records that the paths needed and that the HRTC received.
struct RecordsUse {
  std::uint64_t needed;    ///< union of the closed lists of all cells that a sphere in contact intersected
  std::uint64_t of_model;  ///< all records of the model
  std::optional<std::uint64_t> received, returned;  ///< from the log's totals; none if the HRTC was killed
};

struct ObjectAudit {
  static constexpr std::size_t kMismatchesKept = 5;
  std::string name;
  std::uint32_t index = 0;
  std::uint64_t entries = 0;        ///< logged near the object
  std::uint64_t contact = 0;        ///< of these, with the original surface within the radius
  std::uint64_t exact_contact = 0;  ///< of these, flagged exact
  std::uint64_t truncated = 0;      ///< exact entries with more contacts than an entry holds: not audited
  std::uint64_t audited = 0;
  std::uint64_t audited_near_change = 0;
  std::uint64_t triangles = 0;  ///< compared in all audited entries
  std::uint64_t tangent = 0;    ///< triangles ignored as tangent in audited entries
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
  bool unfinished = false;                  ///< an object has no totals: its HRTC was killed
  std::uint64_t undeclared = 0;             ///< entries of objects that the log does not name
  std::vector<ObjectAudit> objects;         ///< objects that match the original

  /// No mismatch, and no disagreement with FCL.
  [[nodiscard]] bool clean() const noexcept;
};

/// A whole log in memory, about 100 bytes per entry and 16 per contact.
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
/// Throws LogError (missing, not a log, other version), or AuditError naming an entry with an impossible sphere or
/// scale.
[[nodiscard]] ContactLog read_log(const std::filesystem::path& path);

/// Selects the entries to audit, ascending: up to `max` of `near_change.size()` candidates. Up to 40 % of `max` are
/// near a region change, evenly spread; the rest are others, evenly spread. If there are too few others, more entries
/// near a change are selected.
[[nodiscard]] std::vector<std::size_t> choose_entries(const std::vector<bool>& near_change, std::size_t max);

/// Audits the objects of `log` with the digest of `original.model`; without a model, those with its name, or the only
/// one. `second` must be for `original.triangles`.
[[nodiscard]] AuditReport audit(const ContactLog& log, const Original& original, SecondOpinion& second,
                                const AuditOptions& options);

/// Audits `log` against `model`, a mesh (imported and cleaned) or an .spm file (its finest faces). `spm`, which may be
/// empty, is the .spm file of a mesh. Throws the errors of reading them.
[[nodiscard]] AuditReport audit_files(const std::filesystem::path& log, const std::filesystem::path& model,
                                      const std::filesystem::path& spm, const AuditOptions& options);

}  // namespace tactus::tools
