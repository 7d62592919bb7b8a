/// A region as bytes: its closed record list, and those of its records that the receiver lacks.
///
///     region | list: count, (gap, count)* | sent: the same | sent records, in order
///     record: head, u - t, radius, position | faces of the part | further parts: head, faces
///     head:   born count | deformed count << 2 | another part follows << 6
///     faces:  born: face << 4 | order << 1 | last, then u - x; deformed: face << 3 | corner << 1 | last; from the
///             record's second face on, `face` is the signed difference to the one before
///
/// A record's bytes depend on nothing but the record, so any host may send any record to anyone, in any company.
/// Positions keep their float bits. About 40 bytes a record.
#pragma once

#include "spm/codec/bytes.hpp"
#include "spm/codec/result.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

/// `missing` is a subset of the region's list, ascending runs that do not touch. O(runs + missing records).
[[nodiscard]] Bytes encode_region(const Model& model, RegionId region, Span<const Run> missing);

/// Trusts nothing: memory stays within a small multiple of the input. Everything that can be known without the
/// receiver's state is checked here: form and order of the runs, every code, every id against the counts of `summary`,
/// corners older than the vertex they come with, positions within the bounds. About 0.1 us a record.
Result<RegionData> decode_region(Span<const std::uint8_t> bytes, const ModelSummary& summary);

}  // namespace tactus::spm::codec
