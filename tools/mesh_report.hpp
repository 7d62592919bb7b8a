/// Writes the reports of `tactus-mesh` about a model as text and as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "spm/codec/compressed_model.hpp"
#include "spm/offline/certificate.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/offline/verify.hpp"

namespace tactus::tools {

/// Returns the rows of the paper's Table 1, the regions, and the certificate of a probe. If `compressed` is given, adds
/// the sizes of messages in bytes.
[[nodiscard]] nlohmann::ordered_json info_json(const spm::Model& model, const spm::offline::Provenance& provenance,
                                               const spm::offline::Certificate& certificate,
                                               const spm::codec::CompressedModel* compressed = nullptr);
[[nodiscard]] std::string info_text(const spm::Model& model, const spm::offline::Provenance& provenance,
                                    const spm::offline::Certificate& certificate,
                                    const spm::codec::CompressedModel* compressed = nullptr);

[[nodiscard]] nlohmann::ordered_json verification_json(const spm::offline::Verification& verification);
[[nodiscard]] std::string verification_text(const spm::offline::Verification& verification);

/// Returns a line for each kind of dropped element; empty when none was dropped.
[[nodiscard]] std::string dropped_text(const spm::offline::CleanReport& cleaned);

}  // namespace tactus::tools
