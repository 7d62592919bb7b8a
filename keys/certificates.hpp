/// Certificates and signatures, by OpenSSL. Throws KeyError with OpenSSL's reason.
#pragma once

#include <openssl/evp.h>
#include <openssl/x509.h>

#include <array>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "keys/member.hpp"

namespace tactus::keys {

struct Free {
  void operator()(EVP_PKEY* key) const noexcept { EVP_PKEY_free(key); }
  void operator()(X509* certificate) const noexcept { X509_free(certificate); }
  void operator()(X509_CRL* list) const noexcept { X509_CRL_free(list); }
};
using Key = std::unique_ptr<EVP_PKEY, Free>;
using Certificate = std::unique_ptr<X509, Free>;
using RevokedList = std::unique_ptr<X509_CRL, Free>;

/// A certificate authority: its certificate, and the key that signs.
struct Issuer {
  Certificate certificate;
  Key key;
};

/// Subject of a certificate: O=group, OU=unit, CN=name, description=permitted (separated by spaces),
/// serialNumber=serial, dnQualifier=until. A subject with serial number and time of expiry belongs to one certificate
/// only, so whoever knows the subject knows all that it states.
struct Subject {
  std::string group, unit, name;
  Permitted permitted{};
  std::string serial{}, until{};  ///< of a member; seconds since 1970
};

[[nodiscard]] Key make_key();  ///< on the curve P-256
[[nodiscard]] Issuer make_issuer(const Subject& subject, std::time_t from, std::time_t until);
/// Adds serial number and time of expiry to the subject.
[[nodiscard]] Certificate issue(const Issuer& issuer, Subject subject, EVP_PKEY& key, std::time_t from,
                                std::time_t until);
/// The clock of a machine that reads keys may be late by this time, s.
inline constexpr std::time_t kClockTolerance = 3600;
/// Returns a list of these serial numbers (hexadecimal). Its CRL number is the time `made`, which orders lists. It is
/// valid as long as the issuer, so that a list that was made with a wrong clock can be used, too.
[[nodiscard]] RevokedList make_revoked_list(const Issuer& issuer, const std::vector<std::string>& serials,
                                            std::time_t made);
/// Returns the text as S/MIME, signed by the issuer itself.
[[nodiscard]] std::string sign(const Issuer& issuer, const std::string& text);

// PEM, from and to text.
[[nodiscard]] std::string pem_of(X509& certificate);
[[nodiscard]] std::string pem_of(EVP_PKEY& key);
[[nodiscard]] std::string pem_of(X509_CRL& list);
[[nodiscard]] Certificate read_certificate(const std::filesystem::path& file);
/// Returns the first certificate in a text, as the DDS library reads it; null if there is none.
[[nodiscard]] Certificate certificate_in(std::string_view text);
[[nodiscard]] Key read_key(const std::filesystem::path& file);
[[nodiscard]] RevokedList read_revoked_list(const std::filesystem::path& file);
/// Returns the text of a file by `sign`. Throws KeyError unless `signer` has signed it.
[[nodiscard]] std::string read_signed(const std::filesystem::path& file, X509& signer);

[[nodiscard]] Subject subject_of(X509& certificate);
[[nodiscard]] std::array<std::uint8_t, 32> hash_of(const Subject& subject);  ///< SHA-256 of its DER encoding
[[nodiscard]] std::array<std::uint8_t, 32> hash_of_subject(X509& certificate);
[[nodiscard]] std::string subject_text(X509& certificate);  ///< as RFC 2253 writes it
[[nodiscard]] std::string serial_of(X509& certificate);
[[nodiscard]] std::vector<std::string> serials_of(X509_CRL& list);
[[nodiscard]] std::time_t valid_from(X509& certificate);
[[nodiscard]] std::time_t valid_until(X509& certificate);
[[nodiscard]] std::time_t valid_from(X509_CRL& list);
/// Returns whether the authority has signed the certificate.
[[nodiscard]] bool is_issued_by(X509& certificate, X509& authority);
[[nodiscard]] bool is_issued_by(X509_CRL& list, X509& authority);
/// Returns the CRL number; for a list without one, of an earlier version, its begin of validity plus kClockTolerance.
[[nodiscard]] std::time_t made_at(X509_CRL& list);
[[nodiscard]] bool belongs_to(EVP_PKEY& key, X509& certificate);

/// Returns the member of a certificate. Throws KeyError, which names `file`, if its unit is no role.
[[nodiscard]] Member member_of(X509& certificate, X509_CRL& revoked, const std::filesystem::path& file);

}  // namespace tactus::keys
