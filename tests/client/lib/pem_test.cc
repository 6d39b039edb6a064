// SPDX-License-Identifier: Apache-2.0
#include "client/lib/pem.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/test_certificates.h"

namespace sightline::client {
namespace {

using ::testing::HasSubstr;
using testing_support::IssuedCertificate;
using testing_support::TestAuthority;

// Its frame as it was, and something else in the middle of what is between.
std::string Corrupted(std::string pem) {
  pem[pem.size() / 2] = '*';  // No letter of base64.
  return pem;
}

void ExpectError(const absl::Status& status, const std::string& message) {
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr(message));
}

class PemTest : public ::testing::Test {
 protected:
  const TestAuthority authority_{"authority"};
  const IssuedCertificate issued_ = authority_.Issue({.common_name = "localhost"});
};

TEST_F(PemTest, WhatIsWholeIsGood) {
  const IssuedCertificate other = authority_.Issue({.common_name = "other"});
  EXPECT_EQ(CheckCertificates(issued_.certificate), absl::OkStatus());
  EXPECT_EQ(CheckCertificates("Of localhost:\n" + issued_.certificate + authority_.pem()),
            absl::OkStatus());
  EXPECT_EQ(CheckPrivateKey(issued_.key), absl::OkStatus());
  // Both in one file.
  EXPECT_EQ(CheckCertificates(issued_.key + issued_.certificate), absl::OkStatus());
  EXPECT_EQ(CheckPrivateKey(issued_.certificate + issued_.key), absl::OkStatus());
  EXPECT_TRUE(IsKeyOf(issued_.key, issued_.certificate + authority_.pem()));
  EXPECT_FALSE(IsKeyOf(other.key, issued_.certificate));
}

TEST_F(PemTest, WhatIsNotThereIsToldFromWhatIsBroken) {
  ExpectError(CheckCertificates(""), "holds no CERTIFICATE in PEM form");
  ExpectError(CheckCertificates(issued_.key), "holds no CERTIFICATE in PEM form");
  ExpectError(CheckPrivateKey(issued_.certificate), "holds no PRIVATE KEY in PEM form");
  const std::string& good = issued_.certificate;
  const std::string half = good.substr(0, good.size() / 2);
  for (const std::string& pem :
       {Corrupted(good), half, good + Corrupted(good), good + half,
        std::string("-----BEGIN CERTIFICATE-----\n-----END CERTIFICATE-----\n"),
        std::string("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n")}) {
    ExpectError(CheckCertificates(pem), "holds a broken CERTIFICATE in PEM form");
  }
  ExpectError(CheckPrivateKey(Corrupted(issued_.key)), "holds a broken PRIVATE KEY in PEM form");
  ExpectError(CheckPrivateKey("-----BEGIN ENCRYPTED PRIVATE KEY-----\nAAAA\n"
                              "-----END ENCRYPTED PRIVATE KEY-----\n"),
              "holds a key with a passphrase");
}

}  // namespace
}  // namespace sightline::client
