/// Checks a contact log against the original model: every contact that an HRTC logged as exact must be the contact with
/// the original triangles.
///
/// The audit shares no geometry code with the HRTC: it searches in another way and computes in extended precision. For
/// each audited entry it compares the keys of the touched triangles and their depths. A triangle is tangent if its
/// distance differs from the radius by less than kTangencyTolerance. A tangent triangle may be missing or have another depth,
/// because rounding decides whether the tip touches it.
///
/// FCL checks the same entries as a second opinion. A disagreement with FCL is no mismatch, but it makes the audit
/// doubtful.
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

inline constexpr double kTangencyTolerance = 1e-6;  ///< tolerance of distances and depths, m
inline constexpr std::uint32_t kNearChange = 10;  ///< cycles after a region change in which an entry is "near a change"

struct AuditOptions {
  std::uint32_t cycles = 10000;  ///< maximum number of audited cycles per object
};

/// The original model of an object.
struct Original {
  std::string name;                 ///< name of the file, without folder and extension
  std::vector<Corners> triangles;   ///< cleaned, not empty
  std::optional<spm::Model> model;  ///< to count the records that the contacts needed; its owner must outlive this
};

/// An audited entry that differs from the original.
struct Mismatch {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> missing;  ///< keys of touched triangles that the log lacks
  std::vector<std::uint64_t> extra;    ///< keys of logged triangles that are not touched, or that are logged too often
  struct Depth {
    std::uint64_t triangle;
    double logged, expected;  ///< metres
  };
  std::vector<Depth> depths;
};

/// An audited entry for which FCL and the audit differ.
struct Disagreement {
  std::int64_t time_ns;
  std::uint32_t probe;
  std::vector<std::uint64_t> only_audit, only_fcl;  ///< keys of triangles that only the audit, or only FCL, touches
  struct Distance {
    std::optional<double> audit;  ///< metres; empty if larger than the radius
    double fcl;                   ///< metres
  };
  std::optional<Distance> distance;  ///< distance of the nearest triangle, if the two values differ
};

/// FCL's opinions on the audited entries.
struct SecondOpinions {
  static constexpr std::size_t kMaxListed = 5;
  std::uint64_t requested = 0;  ///< entries that FCL checked
  std::uint64_t tangent =
      0;  ///< triangles whose difference is ignored: distance within kTangencyTolerance of the radius
  std::uint64_t disagreed = 0;      ///< entries for which FCL and the audit differ
  std::vector<Disagreement> first;  ///< the first kMaxListed disagreements
};

/// First contact of a probe with the original surface.
struct FirstTouch {
  std::uint32_t probe;
  std::int64_t touch_ns;                 ///< time of the first entry in contact with the original
  std::optional<std::int64_t> exact_ns;  ///< time of the first exact entry in contact with the original
};

/// Numbers of records.
struct RecordsUse {
  std::uint64_t needed;    ///< in the closed lists of all regions that a sphere in contact intersected, without repeats
  std::uint64_t of_model;  ///< in the model
  /// `received`: with repetitions. `returned`: number of these that were received again after an eviction. Both are the
  /// log's totals; empty if the HRTC was killed.
  std::optional<std::uint64_t> received, returned;
};

struct ObjectAudit {
  static constexpr std::size_t kMaxListed = 5;
  std::string name;
  std::uint32_t index = 0;
  std::uint64_t entries = 0;              ///< entries logged near the object
  std::uint64_t contact = 0;              ///< entries in contact with the original surface
  std::uint64_t exact_contact = 0;        ///< entries in contact with the original surface that are logged as exact
  std::uint64_t truncated = 0;            ///< exact entries that are not audited, because they lack some contacts
  std::uint64_t audited = 0;              ///< audited entries
  std::uint64_t audited_near_change = 0;  ///< audited entries within kNearChange cycles of a region change
  std::uint64_t triangles = 0;            ///< triangles compared, over all audited entries
  std::uint64_t tangent = 0;              ///< triangles ignored as tangent, over all audited entries
  std::uint64_t mismatched = 0;           ///< audited entries with a mismatch
  std::vector<Mismatch> mismatches;       ///< the first kMaxListed mismatches
  SecondOpinions second;
  std::vector<FirstTouch> touches;  ///< by probe
  std::optional<RecordsUse> records;
};

struct AuditReport {
  std::string log;       ///< name of the file, without folder and extension
  std::string original;  ///< Original::name
  std::uint64_t original_triangles = 0;
  std::vector<std::string> logged_objects;  ///< names of all objects in the log
  bool is_truncated = false;                ///< the log ends within an entry
  bool is_unfinished = false;               ///< an object has no totals, because its HRTC was killed
  std::uint64_t undeclared = 0;             ///< entries of objects that the log does not name
  std::vector<ObjectAudit> objects;         ///< objects that match the original

  /// Returns whether there is no mismatch and no disagreement with FCL.
  [[nodiscard]] bool clean() const noexcept;
};

/// A complete log in memory. An entry takes about 100 bytes, a contact 16.
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
  bool is_truncated = false;
};
/// Throws LogError for a file that is missing, is no log or has another version, and AuditError for an entry with an
/// impossible sphere or scale.
[[nodiscard]] ContactLog read_log(const std::filesystem::path& path);

/// Selects at most `max` of `near_change.size()` entries for the audit, in ascending order. At most 40 % of them are
/// near a region change, unless there are too few others. Both groups are evenly spread over the log.
[[nodiscard]] std::vector<std::size_t> choose_entries(const std::vector<bool>& near_change, std::size_t max);

/// Audits the objects of `log` whose digest is that of `original.model`. If there is no model, audits the objects with
/// the name of the original, or else the only object of the log. `second` must be for `original.triangles`.
[[nodiscard]] AuditReport audit(const ContactLog& log, const Original& original, SecondOpinion& second,
                                const AuditOptions& options);

/// Audits `log` against the file `model`: a mesh, which is imported and cleaned, or an .spm file, whose finest faces
/// are the original. `spm` is the .spm file that was built from the mesh, or empty. Throws the errors of reading the
/// files.
[[nodiscard]] AuditReport audit_files(const std::filesystem::path& log, const std::filesystem::path& model,
                                      const std::filesystem::path& spm, const AuditOptions& options);

}  // namespace tactus::tools
