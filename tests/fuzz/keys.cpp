/// Files of keys: a certificate, a list of revoked certificates, a private key, or a signed document. The first byte
/// selects one of them.
#include "keys/certificates.hpp"
#include "tests/fuzz/target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace tactus;
  if (size == 0) return 0;
  const fuzz::MemoryFile file{{data + 1, size - 1}};
  try {
    switch (data[0] % 4) {
      case 0: {
        static const keys::RevokedList none{X509_CRL_new()};
        const keys::Certificate certificate = keys::read_certificate(file.path());
        const keys::Member member = keys::member_of(*certificate, *none, "certificate.pem");
        (void)keys::text_of(member.permitted);
        (void)keys::subject_text(*certificate);
        (void)keys::is_issued_by(*certificate, *certificate);
        break;
      }
      case 1: {
        const keys::RevokedList list = keys::read_revoked_list(file.path());
        (void)keys::serials_of(*list);
        (void)keys::made_at(*list);
        break;
      }
      case 2:
        (void)keys::read_key(file.path());
        break;
      default: {
        static const keys::Issuer authority = keys::make_issuer({"lab-keys", "authority", "permissions"}, 0, 1);
        (void)keys::read_signed(file.path(), *authority.certificate);
      }
    }
  } catch (const keys::KeyError&) {
  }
  return 0;
}
