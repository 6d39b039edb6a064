// SPDX-License-Identifier: Apache-2.0
#include "server/auth/certificate_store.h"

#include <sys/stat.h>

#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_certificates.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::IssuedCertificate;
using testing_support::TestAuthority;

class CertificateStoreTest : public ::testing::Test {
 protected:
  void Write(const IssuedCertificate& issued) const {
    std::ofstream(files_.certificate) << issued.certificate;
    std::ofstream(files_.key) << issued.key;
    chmod(files_.key.c_str(), 0600);
  }
  std::string ErrorAt(absl::Time now) const {
    const absl::Status status = ReadTlsBundle(files_, now).status();
    EXPECT_FALSE(status.ok());
    return std::string(status.message());
  }

  const testing_support::TempDir dir_;
  TlsFiles files_{.certificate = dir_.File("cert.pem"), .key = dir_.File("key.pem")};
  const TestAuthority authority_{"authority"};
  const IssuedCertificate good_ = authority_.Issue({.common_name = "localhost"});
};

TEST_F(CertificateStoreTest, WhatIsGoodIsTaken) {
  Write(good_);
  files_.client_ca = dir_.File("ca.pem");
  std::ofstream(files_.client_ca) << authority_.pem();
  const absl::StatusOr<TlsBundle> bundle = ReadTlsBundle(files_, absl::Now());
  ASSERT_TRUE(bundle.ok()) << bundle.status();
  EXPECT_EQ(bundle->certificate, good_.certificate);
  EXPECT_GT(bundle->not_after, absl::Now() + absl::Hours(23));
  EXPECT_LT(bundle->not_after, absl::Now() + absl::Hours(25));
}

TEST_F(CertificateStoreTest, WhatIsWrongIsNamed) {
  Write(good_);
  EXPECT_THAT(ErrorAt(absl::Now() + absl::Hours(48)), HasSubstr("cert.pem: has expired at "));
  EXPECT_THAT(ErrorAt(absl::Now() - absl::Hours(48)), HasSubstr("is not valid before"));
  chmod(files_.key.c_str(), 0644);
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("key.pem has mode 0644"));
  const IssuedCertificate other = authority_.Issue({.common_name = "localhost"});
  Write({good_.certificate, other.key});
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("is not the key of"));
  Write({"nothing", good_.key});
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("cert.pem: must hold PEM certificates"));
  Write({good_.certificate + good_.certificate.substr(0, good_.certificate.size() / 2), good_.key});
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("holds a broken one"));
  Write({good_.certificate, "nothing"});
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("key.pem: must hold a PEM private key"));
  Write(good_);
  files_.client_ca = dir_.File("none.pem");
  EXPECT_THAT(ErrorAt(absl::Now()), HasSubstr("none.pem"));
}

TEST_F(CertificateStoreTest, AReloadTakesTheGoodAndLeavesTheBad) {
  Write(good_);
  const auto store = CertificateStore::Open(files_);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_FALSE(*(*store)->Reload());  // Nothing new.
  const IssuedCertificate expired =
      authority_.Issue({.common_name = "localhost", .until_seconds = -60});
  Write(expired);
  EXPECT_FALSE((*store)->Reload().ok());
  EXPECT_EQ((*store)->current()->certificate, good_.certificate);
  const IssuedCertificate next = authority_.Issue({.common_name = "localhost"});
  Write(next);
  EXPECT_TRUE(*(*store)->Reload());
  EXPECT_EQ((*store)->current()->certificate, next.certificate);
}

}  // namespace
}  // namespace sightline
