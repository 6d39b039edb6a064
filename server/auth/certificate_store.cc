// SPDX-License-Identifier: Apache-2.0
#include "server/auth/certificate_store.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "core/base/status_macros.h"
#include "server/auth/secret_file.h"

namespace sightline {
namespace {

struct Free {
  void operator()(BIO* bio) const { BIO_free(bio); }
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
using BioPtr = std::unique_ptr<BIO, Free>;
using CertificatePtr = std::unique_ptr<X509, Free>;
using KeyPtr = std::unique_ptr<EVP_PKEY, Free>;

absl::Status Bad(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": ", what));
}

BioPtr Open(const std::string& pem) {
  return BioPtr(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

// No passphrase is asked for: nobody is there to type one.
int NoPassphrase(char*, int, int, void*) { return 0; }

absl::StatusOr<std::vector<CertificatePtr>> ParseCertificates(const std::string& path,
                                                              const std::string& pem) {
  std::vector<CertificatePtr> certificates;
  const BioPtr bio = Open(pem);
  ERR_clear_error();
  while (X509* const next = PEM_read_bio_X509(bio.get(), nullptr, &NoPassphrase, nullptr)) {
    certificates.emplace_back(next);
  }
  const unsigned long error = ERR_peek_last_error();
  ERR_clear_error();
  // The end of a file of certificates is the error that there is no other.
  if (certificates.empty() || ERR_GET_REASON(error) != PEM_R_NO_START_LINE) {
    return Bad(path, "must hold PEM certificates, and holds a broken one or none");
  }
  return certificates;
}

absl::Time ToTime(const ASN1_TIME* time) {
  std::tm broken_down{};
  if (ASN1_TIME_to_tm(time, &broken_down) != 1) return absl::InfinitePast();
  return absl::FromTimeT(timegm(&broken_down));
}

absl::Status CheckDates(const std::string& path, const X509* certificate, absl::Time now) {
  const absl::Time from = ToTime(X509_get0_notBefore(certificate));
  const absl::Time until = ToTime(X509_get0_notAfter(certificate));
  const auto text = [](absl::Time time) {
    return absl::FormatTime(absl::RFC3339_sec, time, absl::UTCTimeZone());
  };
  if (now < from) return Bad(path, absl::StrCat("is not valid before ", text(from)));
  if (now > until) return Bad(path, absl::StrCat("has expired at ", text(until)));
  return absl::OkStatus();
}

absl::Status CheckKey(const TlsFiles& files, X509* certificate, const std::string& pem) {
  const BioPtr bio = Open(pem);
  const KeyPtr key(PEM_read_bio_PrivateKey(bio.get(), nullptr, &NoPassphrase, nullptr));
  ERR_clear_error();
  if (key == nullptr) return Bad(files.key, "must hold a PEM private key without a passphrase");
  const bool matches = X509_check_private_key(certificate, key.get()) == 1;
  ERR_clear_error();
  if (matches) return absl::OkStatus();
  return Bad(files.key, absl::StrCat("is not the key of ", files.certificate));
}

absl::Status CheckAuthorities(const std::string& path, const std::string& pem, absl::Time now) {
  SL_ASSIGN_OR_RETURN(const std::vector<CertificatePtr> authorities, ParseCertificates(path, pem));
  absl::Status last;
  for (const CertificatePtr& authority : authorities) {
    last = CheckDates(path, authority.get(), now);
    if (last.ok()) return last;  // One that works is enough: rings of them are rolled over.
  }
  return last;
}

}  // namespace

absl::StatusOr<TlsBundle> ReadTlsBundle(const TlsFiles& files, absl::Time now) {
  TlsBundle bundle;
  SL_ASSIGN_OR_RETURN(bundle.certificate, ReadPublicFile(files.certificate));
  SL_ASSIGN_OR_RETURN(bundle.key, ReadSecretFile(files.key));
  SL_ASSIGN_OR_RETURN(const std::vector<CertificatePtr> chain,
                      ParseCertificates(files.certificate, bundle.certificate));
  bundle.not_after = absl::InfiniteFuture();
  for (const CertificatePtr& certificate : chain) {
    SL_RETURN_IF_ERROR(CheckDates(files.certificate, certificate.get(), now));
    bundle.not_after = std::min(bundle.not_after, ToTime(X509_get0_notAfter(certificate.get())));
  }
  SL_RETURN_IF_ERROR(CheckKey(files, chain.front().get(), bundle.key));
  if (!files.client_ca.empty()) {
    SL_ASSIGN_OR_RETURN(bundle.client_ca, ReadPublicFile(files.client_ca));
    SL_RETURN_IF_ERROR(CheckAuthorities(files.client_ca, bundle.client_ca, now));
  }
  return bundle;
}

absl::StatusOr<std::unique_ptr<CertificateStore>> CertificateStore::Open(const TlsFiles& files) {
  SL_ASSIGN_OR_RETURN(TlsBundle bundle, ReadTlsBundle(files, absl::Now()));
  return std::unique_ptr<CertificateStore>(new CertificateStore(files, std::move(bundle)));
}

absl::StatusOr<bool> CertificateStore::Reload() {
  SL_ASSIGN_OR_RETURN(TlsBundle bundle, ReadTlsBundle(files_, absl::Now()));
  MutexLock lock(mutex_);
  if (bundle == *current_) return false;
  current_ = std::make_shared<TlsBundle>(std::move(bundle));
  return true;
}

std::shared_ptr<const TlsBundle> CertificateStore::current() const {
  MutexLock lock(mutex_);
  return current_;
}

}  // namespace sightline
