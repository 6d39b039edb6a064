// SPDX-License-Identifier: Apache-2.0
//
// The server's certificate, its key, and the authorities that clients' certificates are checked
// against: read from files, validated, and read again when the files change. gRPC itself takes a
// broken file as it is and then refuses every handshake, so nothing reaches it unvalidated.
//
// Invariant: current() is the last bundle that was good in every respect; a Reload that fails
// leaves it.
//
// Thread safety: every method from any thread; Reload reads files, so not on a gRPC thread.
//
//   SL_ASSIGN_OR_RETURN(auto store, CertificateStore::Open({.certificate = "a.pem", ...}));
//   std::shared_ptr<const TlsBundle> bundle = store->current();
#ifndef SIGHTLINE_SERVER_AUTH_CERTIFICATE_STORE_H_
#define SIGHTLINE_SERVER_AUTH_CERTIFICATE_STORE_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"

namespace sightline {

struct TlsFiles {
  std::string certificate;  // PEM, the server's own first, then its chain. Empty: no TLS.
  std::string key;          // PEM.
  std::string client_ca;    // PEM; empty: clients show no certificate.
};

struct TlsBundle {
  std::string certificate, key, client_ca;  // PEM.
  absl::Time not_after;                     // The earliest end of the server's chain.

  friend bool operator==(const TlsBundle&, const TlsBundle&) = default;
};

class CertificateStore {
 public:
  // InvalidArgument naming the file: no PEM certificate or key in it, the key belongs to another
  // certificate, the certificate or every authority is expired, or not valid yet. What reading
  // returns; PermissionDenied (others may read the key).
  static absl::StatusOr<std::unique_ptr<CertificateStore>> Open(const TlsFiles& files);

  // Reads again. Whether there is a new bundle now.
  absl::StatusOr<bool> Reload();
  std::shared_ptr<const TlsBundle> current() const;

 private:
  CertificateStore(TlsFiles files, TlsBundle bundle)
      : files_(std::move(files)), current_(std::make_shared<TlsBundle>(std::move(bundle))) {}

  const TlsFiles files_;
  mutable Mutex mutex_;
  std::shared_ptr<const TlsBundle> current_ ABSL_GUARDED_BY(mutex_);
};

// The checks alone, at time `now`.
absl::StatusOr<TlsBundle> ReadTlsBundle(const TlsFiles& files, absl::Time now);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_CERTIFICATE_STORE_H_
