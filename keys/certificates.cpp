#include "keys/certificates.hpp"

#include <openssl/bio.h>
#include <openssl/bn.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509v3.h>

#include <array>
#include <cstring>

#include "keys/member.hpp"

namespace tactus::keys {
namespace {

struct FreeMore {
  void operator()(BIO* bio) const noexcept { BIO_free_all(bio); }
  void operator()(BIGNUM* number) const noexcept { BN_free(number); }
  void operator()(ASN1_STRING* value) const noexcept { ASN1_STRING_free(value); }  // also a time or an integer
  void operator()(PKCS7* message) const noexcept { PKCS7_free(message); }
  void operator()(STACK_OF(X509) * list) const noexcept { sk_X509_free(list); }  // not its certificates
  void operator()(X509_EXTENSION* extension) const noexcept { X509_EXTENSION_free(extension); }
  void operator()(X509_NAME* name) const noexcept { X509_NAME_free(name); }
  void operator()(X509_REVOKED* entry) const noexcept { X509_REVOKED_free(entry); }
};
template <class T>
using Owner = std::unique_ptr<T, FreeMore>;

[[noreturn]] void fail(const std::string& what) {
  const unsigned long code = ERR_get_error();
  ERR_clear_error();
  const char* const reason =
      ERR_SYSTEM_ERROR(code) ? std::strerror(ERR_GET_REASON(code)) : ERR_reason_error_string(code);
  throw KeyError(what + (reason != nullptr ? std::string{": "} + reason : ""));
}
/// `remedy` begins with a separator.
[[noreturn]] void fail_to_read(const std::filesystem::path& file, const char* expected, const char* remedy = "") {
  ERR_clear_error();
  throw KeyError(file.string() + ": found no " + expected + remedy);
}
/// Throws unless a function of OpenSSL has succeeded.
void require(bool succeeded, const char* what) {
  if (!succeeded) fail(what);
}

Owner<BIO> memory() {
  Owner<BIO> bio{BIO_new(BIO_s_mem())};
  require(bio != nullptr, "memory");
  return bio;
}
std::string text_of(BIO& bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(&bio, &data);
  return {data, static_cast<std::size_t>(size)};
}

void add_extension(X509& certificate, X509& issuer, int kind, const char* value) {
  X509V3_CTX context{};
  X509V3_set_ctx(&context, &issuer, &certificate, nullptr, nullptr, 0);
  const Owner<X509_EXTENSION> extension{X509V3_EXT_conf_nid(nullptr, &context, kind, value)};
  require(extension != nullptr && X509_add_ext(&certificate, extension.get(), -1) == 1, "extension of a certificate");
}

void set_name(X509_NAME& name, const Subject& subject) {
  const std::string permitted = keys::text_of(subject.permitted);
  const std::pair<const char*, const std::string*> parts[] = {{"O", &subject.group},
                                                              {"OU", &subject.unit},
                                                              {"CN", &subject.name},
                                                              {"description", &permitted},
                                                              {"serialNumber", &subject.serial},
                                                              {"dnQualifier", &subject.until}};
  for (const auto& [kind, text] : parts) {
    if (text->empty()) continue;
    require(X509_NAME_add_entry_by_txt(&name, kind, MBSTRING_UTF8, reinterpret_cast<const unsigned char*>(text->data()),
                                       static_cast<int>(text->size()), -1, 0) == 1,
            "subject of a certificate");
  }
}

/// Makes a certificate without subject and signature.
Certificate draft(EVP_PKEY& key, std::time_t from, std::time_t until) {
  Certificate certificate{X509_new()};
  const Owner<BIGNUM> serial{BN_new()};
  require(certificate != nullptr && serial != nullptr, "memory");
  constexpr int kSerialBits = 159;  // a serial number has at most 20 bytes, and is positive
  require(BN_rand(serial.get(), kSerialBits, BN_RAND_TOP_ONE, BN_RAND_BOTTOM_ANY) == 1 &&
              BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(certificate.get())) != nullptr,
          "serial number");
  require(X509_set_version(certificate.get(), X509_VERSION_3) == 1 &&
              X509_time_adj_ex(X509_getm_notBefore(certificate.get()), 0, 0, &from) != nullptr &&
              X509_time_adj_ex(X509_getm_notAfter(certificate.get()), 0, 0, &until) != nullptr &&
              X509_set_pubkey(certificate.get(), &key) == 1,
          "certificate");
  return certificate;
}

void sign_certificate(X509& certificate, X509& issuer, EVP_PKEY& key) {
  require(X509_set_issuer_name(&certificate, X509_get_subject_name(&issuer)) == 1 &&
              X509_sign(&certificate, &key, EVP_sha256()) > 0,
          "signature of a certificate");
}

Owner<BIO> open_file(const std::filesystem::path& file) {
  Owner<BIO> bio{BIO_new_file(file.c_str(), "r")};
  if (bio == nullptr) fail(file.string() + ": cannot be read");
  return bio;
}

std::time_t time_of(const ASN1_TIME* time) {
  std::tm utc{};
  require(ASN1_TIME_to_tm(time, &utc) == 1, "time of a certificate");
  return timegm(&utc);
}

std::string hex_of(const ASN1_INTEGER* number) {
  const Owner<BIGNUM> value{ASN1_INTEGER_to_BN(number, nullptr)};
  require(value != nullptr, "serial number");
  char* const hex = BN_bn2hex(value.get());
  require(hex != nullptr, "serial number");
  const std::string text = hex;
  OPENSSL_free(hex);
  return text;
}

std::string entry_of(X509& certificate, int kind) {
  X509_NAME* const name = X509_get_subject_name(&certificate);
  const int at = X509_NAME_get_index_by_NID(name, kind, -1);
  if (at < 0) return "";
  unsigned char* text = nullptr;
  const int size = ASN1_STRING_to_UTF8(&text, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(name, at)));
  if (size < 0) return "";
  const std::string result(reinterpret_cast<const char*>(text), static_cast<std::size_t>(size));
  OPENSSL_free(text);
  return result;
}

std::array<std::uint8_t, 32> hash_of_name(const X509_NAME& name) {
  std::array<std::uint8_t, 32> hash{};
  require(X509_NAME_digest(&name, EVP_sha256(), hash.data(), nullptr) == 1, "hash of a subject");
  return hash;
}

}  // namespace

Key make_key() {
  Key key{EVP_EC_gen("P-256")};
  require(key != nullptr, "private key");
  return key;
}

Issuer make_issuer(const Subject& subject, std::time_t from, std::time_t until) {
  Issuer issuer;
  issuer.key = make_key();
  issuer.certificate = draft(*issuer.key, from, until);
  X509& certificate = *issuer.certificate;
  set_name(*X509_get_subject_name(&certificate), subject);
  add_extension(certificate, certificate, NID_basic_constraints, "critical,CA:TRUE");
  add_extension(certificate, certificate, NID_key_usage, "critical,digitalSignature,keyCertSign,cRLSign");
  sign_certificate(certificate, certificate, *issuer.key);
  return issuer;
}

Certificate issue(const Issuer& issuer, Subject subject, EVP_PKEY& key, std::time_t from, std::time_t until) {
  Certificate certificate = draft(key, from, until);
  subject.serial = serial_of(*certificate);
  subject.until = std::to_string(until);
  set_name(*X509_get_subject_name(certificate.get()), subject);
  add_extension(*certificate, *issuer.certificate, NID_basic_constraints, "critical,CA:FALSE");
  add_extension(*certificate, *issuer.certificate, NID_key_usage, "critical,digitalSignature");
  sign_certificate(*certificate, *issuer.certificate, *issuer.key);
  return certificate;
}

RevokedList make_revoked_list(const Issuer& issuer, const std::vector<std::string>& serials, std::time_t made) {
  RevokedList list{X509_CRL_new()};
  // A list that is not valid yet, or that has expired, would refuse all members.
  const Owner<ASN1_TIME> from{ASN1_TIME_set(nullptr, valid_from(*issuer.certificate))};
  const Owner<ASN1_TIME> until{ASN1_TIME_set(nullptr, valid_until(*issuer.certificate))};
  const Owner<ASN1_INTEGER> order{ASN1_INTEGER_new()};
  require(list != nullptr && from != nullptr && until != nullptr && order != nullptr &&
              ASN1_INTEGER_set_int64(order.get(), made) == 1 && X509_CRL_set_version(list.get(), 1) == 1 &&
              X509_CRL_add1_ext_i2d(list.get(), NID_crl_number, order.get(), 0, 0) == 1 &&
              X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(issuer.certificate.get())) == 1 &&
              X509_CRL_set1_lastUpdate(list.get(), from.get()) == 1 &&
              X509_CRL_set1_nextUpdate(list.get(), until.get()) == 1,
          "list of revoked certificates");
  for (const std::string& serial : serials) {
    BIGNUM* parsed = nullptr;
    require(BN_hex2bn(&parsed, serial.c_str()) > 0, "serial number");
    const Owner<BIGNUM> number{parsed};
    const Owner<ASN1_INTEGER> value{BN_to_ASN1_INTEGER(number.get(), nullptr)};
    Owner<X509_REVOKED> entry{X509_REVOKED_new()};
    require(value != nullptr && entry != nullptr && X509_REVOKED_set_serialNumber(entry.get(), value.get()) == 1 &&
                X509_REVOKED_set_revocationDate(entry.get(), from.get()) == 1 &&
                X509_CRL_add0_revoked(list.get(), entry.get()) == 1,
            "list of revoked certificates");
    (void)entry.release();  // the list owns it now
  }
  require(X509_CRL_sort(list.get()) == 1 && X509_CRL_sign(list.get(), issuer.key.get(), EVP_sha256()) > 0,
          "list of revoked certificates");
  return list;
}

std::string sign(const Issuer& issuer, const std::string& text) {
  const auto input = [&] {
    Owner<BIO> bio{BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))};
    require(bio != nullptr, "memory");
    return bio;
  };
  constexpr int kFlags = PKCS7_DETACHED | PKCS7_TEXT;
  const Owner<PKCS7> message{PKCS7_sign(issuer.certificate.get(), issuer.key.get(), nullptr, input().get(), kFlags)};
  const Owner<BIO> output = memory();
  require(message != nullptr && SMIME_write_PKCS7(output.get(), message.get(), input().get(), kFlags) == 1,
          "signature of a document");
  return text_of(*output);
}

std::string pem_of(X509& certificate) {
  const Owner<BIO> bio = memory();
  require(PEM_write_bio_X509(bio.get(), &certificate) == 1, "certificate");
  return text_of(*bio);
}
std::string pem_of(EVP_PKEY& key) {
  const Owner<BIO> bio = memory();
  require(PEM_write_bio_PrivateKey(bio.get(), &key, nullptr, nullptr, 0, nullptr, nullptr) == 1, "private key");
  return text_of(*bio);
}
std::string pem_of(X509_CRL& list) {
  const Owner<BIO> bio = memory();
  require(PEM_write_bio_X509_CRL(bio.get(), &list) == 1, "list of revoked certificates");
  return text_of(*bio);
}

Certificate read_certificate(const std::filesystem::path& file) {
  Certificate certificate{PEM_read_bio_X509(open_file(file).get(), nullptr, nullptr, nullptr)};
  if (certificate == nullptr) fail_to_read(file, "certificate (PEM)");
  return certificate;
}
Certificate certificate_in(std::string_view text) {
  const Owner<BIO> bio{BIO_new_mem_buf(text.data(), static_cast<int>(text.size()))};
  require(bio != nullptr, "memory");
  Certificate certificate{PEM_read_bio_X509_AUX(bio.get(), nullptr, nullptr, nullptr)};
  ERR_clear_error();
  return certificate;
}
Key read_key(const std::filesystem::path& file) {
  // Without a password: the program starts alone.
  Key key{PEM_read_bio_PrivateKey(open_file(file).get(), nullptr, nullptr, const_cast<char*>(""))};
  if (key == nullptr) fail_to_read(file, "private key without a password (PEM)");
  return key;
}
RevokedList read_revoked_list(const std::filesystem::path& file) {
  RevokedList list{PEM_read_bio_X509_CRL(open_file(file).get(), nullptr, nullptr, nullptr)};
  if (list == nullptr)
    fail_to_read(file, "list of revoked certificates (PEM)",
                 "; copy that of the authority, or of another member, again");
  return list;
}
std::string read_signed(const std::filesystem::path& file, X509& signer) {
  BIO* text = nullptr;
  const Owner<PKCS7> message{SMIME_read_PKCS7(open_file(file).get(), &text)};
  const Owner<BIO> signed_text{text}, output = memory();
  const Owner<STACK_OF(X509)> signers{sk_X509_new_null()};
  require(signers != nullptr && sk_X509_push(signers.get(), &signer) > 0, "memory");
  // NOINTERN: only `signer` counts, not the certificates in the message. NOVERIFY: its own issuer is not checked.
  constexpr int kFlags = PKCS7_NOINTERN | PKCS7_NOVERIFY | PKCS7_TEXT;
  if (message == nullptr || signed_text == nullptr ||
      PKCS7_verify(message.get(), signers.get(), nullptr, signed_text.get(), output.get(), kFlags) != 1)
    fail_to_read(file, "document that the authority has signed", "; copy the whole folder of the member again");
  return text_of(*output);
}

Subject subject_of(X509& certificate) {
  return {entry_of(certificate, NID_organizationName), entry_of(certificate, NID_organizationalUnitName),
          entry_of(certificate, NID_commonName),       permitted_in(entry_of(certificate, NID_description)),
          entry_of(certificate, NID_serialNumber),     entry_of(certificate, NID_dnQualifier)};
}

std::array<std::uint8_t, 32> hash_of(const Subject& subject) {
  const Owner<X509_NAME> name{X509_NAME_new()};
  require(name != nullptr, "memory");
  set_name(*name, subject);
  return hash_of_name(*name);
}

std::array<std::uint8_t, 32> hash_of_subject(X509& certificate) {
  return hash_of_name(*X509_get_subject_name(&certificate));
}

std::string subject_text(X509& certificate) {
  const Owner<BIO> bio = memory();
  require(X509_NAME_print_ex(bio.get(), X509_get_subject_name(&certificate), 0, XN_FLAG_RFC2253) >= 0, "subject");
  return text_of(*bio);
}

std::string serial_of(X509& certificate) { return hex_of(X509_get0_serialNumber(&certificate)); }

std::vector<std::string> serials_of(X509_CRL& list) {
  std::vector<std::string> serials;
  STACK_OF(X509_REVOKED)* const entries = X509_CRL_get_REVOKED(&list);
  for (int i = 0; i < sk_X509_REVOKED_num(entries); ++i)
    serials.push_back(hex_of(X509_REVOKED_get0_serialNumber(sk_X509_REVOKED_value(entries, i))));
  return serials;
}

std::time_t valid_from(X509& certificate) { return time_of(X509_get0_notBefore(&certificate)); }
std::time_t valid_until(X509& certificate) { return time_of(X509_get0_notAfter(&certificate)); }
std::time_t valid_from(X509_CRL& list) { return time_of(X509_CRL_get0_lastUpdate(&list)); }

bool is_issued_by(X509& certificate, X509& authority) {
  const bool is_valid = X509_NAME_cmp(X509_get_issuer_name(&certificate), X509_get_subject_name(&authority)) == 0 &&
                        X509_verify(&certificate, X509_get0_pubkey(&authority)) == 1;
  ERR_clear_error();
  return is_valid;
}

bool is_issued_by(X509_CRL& list, X509& authority) {
  const bool is_valid = X509_NAME_cmp(X509_CRL_get_issuer(&list), X509_get_subject_name(&authority)) == 0 &&
                        X509_CRL_verify(&list, X509_get0_pubkey(&authority)) == 1;
  ERR_clear_error();
  return is_valid;
}

std::time_t made_at(X509_CRL& list) {
  const Owner<ASN1_INTEGER> number{
      static_cast<ASN1_INTEGER*>(X509_CRL_get_ext_d2i(&list, NID_crl_number, nullptr, nullptr))};
  std::int64_t made = 0;
  const bool has_number = number != nullptr && ASN1_INTEGER_get_int64(&made, number.get()) == 1;
  ERR_clear_error();
  return has_number ? made : valid_from(list) + kClockTolerance;
}

bool belongs_to(EVP_PKEY& key, X509& certificate) {
  const bool belongs = X509_check_private_key(&certificate, &key) == 1;
  ERR_clear_error();
  return belongs;
}

}  // namespace tactus::keys
