// SPDX-License-Identifier: Apache-2.0
//
// Certificate authorities and certificates made on the spot, for tests of TLS.
//
// Thread safety: constant after construction.
//
//   const TestAuthority authority("authority");
//   const IssuedCertificate server = authority.Issue({.common_name = "localhost"});
#ifndef SIGHTLINE_TESTS_SUPPORT_TEST_CERTIFICATES_H_
#define SIGHTLINE_TESTS_SUPPORT_TEST_CERTIFICATES_H_

#include <cstdint>
#include <memory>
#include <string>

namespace sightline::testing_support {

struct CertificateRequest {
  std::string common_name;
  // As OpenSSL writes them: "DNS:localhost,IP:127.0.0.1,URI:spiffe://a/b"; empty: none.
  std::string alternative_names;
  int64_t from_seconds = -3600, until_seconds = 86400;  // Relative to now.
};

struct IssuedCertificate {
  std::string certificate, key;  // PEM.
};

class TestAuthority {
 public:
  explicit TestAuthority(const std::string& name);
  ~TestAuthority();

  std::string pem() const;
  IssuedCertificate Issue(const CertificateRequest& request) const;

 private:
  struct Parts;
  const std::unique_ptr<Parts> parts_;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_TEST_CERTIFICATES_H_
