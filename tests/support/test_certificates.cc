// SPDX-License-Identifier: Apache-2.0
#include "tests/support/test_certificates.h"

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <functional>

namespace sightline::testing_support {
namespace {

// Everything below works, or no test of TLS can go on.
void Must(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "making a test certificate: %s failed\n", what);
  std::abort();
}

std::string ToPem(const std::function<int(BIO*)>& write) {
  BIO* const bio = BIO_new(BIO_s_mem());
  Must(bio != nullptr && write(bio) == 1, "writing PEM");
  char* bytes = nullptr;
  const long length = BIO_get_mem_data(bio, &bytes);
  std::string pem(bytes, static_cast<size_t>(length));
  BIO_free(bio);
  return pem;
}

void AddExtension(X509* certificate, X509* issuer, int kind, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  X509_EXTENSION* const extension = X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str());
  Must(extension != nullptr && X509_add_ext(certificate, extension, -1) == 1, value.c_str());
  X509_EXTENSION_free(extension);
}

// Unsigned, and without an issuer.
X509* Make(const CertificateRequest& request, EVP_PKEY* key) {
  static std::atomic<long> serial = 1;
  X509* const made = X509_new();
  Must(made != nullptr && X509_set_version(made, 2) == 1, "X509_new");
  ASN1_INTEGER_set(X509_get_serialNumber(made), ++serial);
  X509_gmtime_adj(X509_getm_notBefore(made), request.from_seconds);
  X509_gmtime_adj(X509_getm_notAfter(made), request.until_seconds);
  X509_set_pubkey(made, key);
  X509_NAME_add_entry_by_txt(X509_get_subject_name(made), "CN", MBSTRING_UTF8,
                             reinterpret_cast<const unsigned char*>(request.common_name.c_str()),
                             -1, -1, 0);
  return made;
}

}  // namespace

struct TestAuthority::Parts {
  EVP_PKEY* key = nullptr;
  X509* certificate = nullptr;
};

TestAuthority::TestAuthority(const std::string& name) : parts_(std::make_unique<Parts>()) {
  parts_->key = EVP_EC_gen("P-256");
  Must(parts_->key != nullptr, "EVP_EC_gen");
  parts_->certificate = Make({.common_name = name}, parts_->key);
  X509* const self = parts_->certificate;
  X509_set_issuer_name(self, X509_get_subject_name(self));
  AddExtension(self, self, NID_basic_constraints, "critical,CA:TRUE");
  AddExtension(self, self, NID_key_usage, "critical,keyCertSign,cRLSign");
  Must(X509_sign(self, parts_->key, EVP_sha256()) > 0, "X509_sign");
}

TestAuthority::~TestAuthority() {
  X509_free(parts_->certificate);
  EVP_PKEY_free(parts_->key);
}

std::string TestAuthority::pem() const {
  return ToPem([&](BIO* bio) { return PEM_write_bio_X509(bio, parts_->certificate); });
}

IssuedCertificate TestAuthority::Issue(const CertificateRequest& request) const {
  EVP_PKEY* const key = EVP_EC_gen("P-256");
  Must(key != nullptr, "EVP_EC_gen");
  X509* const made = Make(request, key);
  X509_set_issuer_name(made, X509_get_subject_name(parts_->certificate));
  if (!request.alternative_names.empty()) {
    AddExtension(made, parts_->certificate, NID_subject_alt_name, request.alternative_names);
  }
  Must(X509_sign(made, parts_->key, EVP_sha256()) > 0, "X509_sign");
  IssuedCertificate issued;
  issued.certificate = ToPem([&](BIO* bio) { return PEM_write_bio_X509(bio, made); });
  issued.key = ToPem([&](BIO* bio) {
    return PEM_write_bio_PrivateKey(bio, key, nullptr, nullptr, 0, nullptr, nullptr);
  });
  X509_free(made);
  EVP_PKEY_free(key);
  return issued;
}

}  // namespace sightline::testing_support
