// SPDX-License-Identifier: Apache-2.0
#include "client/lib/pem.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace sightline::client {
namespace {

template <auto kFree>
struct Freed {
  template <typename T>
  void operator()(T* object) const {
    kFree(object);
  }
};
using BioPtr = std::unique_ptr<BIO, Freed<&BIO_free>>;
using KeyPtr = std::unique_ptr<EVP_PKEY, Freed<&EVP_PKEY_free>>;
using CertificatePtr = std::unique_ptr<X509, Freed<&X509_free>>;

BioPtr Open(const std::string& pem) {
  return BioPtr(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

int NoPassphrase(char*, int, int, void*) { return 0; }

// Null: none, a broken one, or one that wants a passphrase.
KeyPtr ReadKey(const std::string& pem) {
  KeyPtr key(PEM_read_bio_PrivateKey(Open(pem).get(), nullptr, &NoPassphrase, nullptr));
  ERR_clear_error();
  return key;
}

// The first of the file; null where there is none, or any of its parts is broken.
CertificatePtr ReadCertificate(const std::string& pem) {
  STACK_OF(X509_INFO)* const parts =
      PEM_X509_INFO_read_bio(Open(pem).get(), nullptr, &NoPassphrase, nullptr);
  ERR_clear_error();
  CertificatePtr first;
  for (int i = 0; i < sk_X509_INFO_num(parts) && first == nullptr; ++i) {
    X509* const certificate = sk_X509_INFO_value(parts, i)->x509;
    if (certificate != nullptr && X509_up_ref(certificate) == 1) first.reset(certificate);
  }
  sk_X509_INFO_pop_free(parts, &X509_INFO_free);
  return first;
}

absl::Status Unreadable(const std::string& pem, absl::string_view block) {
  const bool begins =
      absl::StrContains(pem, "-----BEGIN ") && absl::StrContains(pem, absl::StrCat(block, "-----"));
  return absl::InvalidArgumentError(
      begins ? absl::StrCat("holds a broken ", block, " in PEM form")
             : absl::StrCat("holds no ", block, " in PEM form (-----BEGIN ...)"));
}

}  // namespace

absl::Status CheckCertificates(const std::string& pem) {
  return ReadCertificate(pem) != nullptr ? absl::OkStatus() : Unreadable(pem, "CERTIFICATE");
}

absl::Status CheckPrivateKey(const std::string& pem) {
  if (ReadKey(pem) != nullptr) return absl::OkStatus();
  if (absl::StrContains(pem, "ENCRYPTED")) {
    return absl::InvalidArgumentError("holds a key with a passphrase, which nobody is asked for");
  }
  return Unreadable(pem, "PRIVATE KEY");
}

bool IsKeyOf(const std::string& key_pem, const std::string& certificate_pem) {
  const KeyPtr key = ReadKey(key_pem);
  const bool is = X509_check_private_key(ReadCertificate(certificate_pem).get(), key.get()) == 1;
  ERR_clear_error();
  return is;
}

}  // namespace sightline::client
