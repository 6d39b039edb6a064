// SPDX-License-Identifier: Apache-2.0
//
// Whether PEM files hold what gRPC is to be given: it takes whatever they hold, and tells of what
// is broken only by connections that never come about.
//
// Errors are InvalidArgument, and go on behind the file's name: "holds no CERTIFICATE in PEM form".
//
// Thread safety: functions.
//
//   if (absl::Status status = CheckCertificates(pem); !status.ok()) return status;
#ifndef SIGHTLINE_CLIENT_LIB_PEM_H_
#define SIGHTLINE_CLIENT_LIB_PEM_H_

#include <string>

#include "absl/status/status.h"

namespace sightline::client {

// At least one certificate, and all of them whole.
absl::Status CheckCertificates(const std::string& pem);
// A private key that wants no passphrase: nobody is there to type one.
absl::Status CheckPrivateKey(const std::string& pem);
// Whether the key is that of the first certificate. REQUIRES: both passed their checks.
bool IsKeyOf(const std::string& key_pem, const std::string& certificate_pem);

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_PEM_H_
