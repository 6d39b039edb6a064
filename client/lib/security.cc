// SPDX-License-Identifier: Apache-2.0
#include "client/lib/security.h"

#include <fcntl.h>
#include <grpc/impl/codegen/grpc_types.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/client_interceptor.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/lib/pem.h"

namespace sightline::client {
namespace {

namespace grpcx = grpc::experimental;

constexpr size_t kMaxFileBytes = 1 << 20;

absl::StatusOr<std::string> ReadWhole(const std::string& path, bool secret) {
  // O_NONBLOCK: opening a named pipe would wait for its writer, who may never come.
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return absl::ErrnoToStatus(errno, absl::StrCat("cannot read ", path));
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(fdopen(descriptor, "rb"),
                                                             &std::fclose);
  if (file == nullptr) {
    close(descriptor);
    return absl::ResourceExhaustedError(absl::StrCat("no memory to read ", path));
  }
  struct stat facts {};
  if (fstat(descriptor, &facts) != 0 || !S_ISREG(facts.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is not a regular file"));
  }
  if (secret && (facts.st_mode & S_IRWXO) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat("others may use ", path, ", which holds a secret: chmod 600 it"));
  }
  std::string text(kMaxFileBytes + 1, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file.get()));
  if (std::ferror(file.get()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat("cannot read ", path));
  }
  if (text.size() > kMaxFileBytes) {
    return absl::InvalidArgumentError(absl::StrCat(path, " has more than ", kMaxFileBytes,
                                                   " bytes: name a file of what is needed alone"));
  }
  return text;
}

// Reads `path`, if it names a file, into `*out`. gRPC would tell of one that is no good only by
// connections that never come about.
absl::Status Load(const std::string& path, bool secret, absl::Status (*check)(const std::string&),
                  std::string* out) {
  if (path.empty()) return absl::OkStatus();
  absl::StatusOr<std::string> text = ReadWhole(path, secret);
  if (!text.ok()) return text.status();
  if (const absl::Status status = check(*text); !status.ok()) {
    return absl::Status(status.code(), absl::StrCat(path, " ", status.message()));
  }
  *out = *std::move(text);
  return absl::OkStatus();
}

bool WantsTls(const SecurityFiles& files) {
  return !files.ca.empty() || !files.certificate.empty();
}

// Call credentials would do this over TLS alone; Unix sockets have their own protection.
class TokenInterceptor final : public grpcx::Interceptor {
 public:
  explicit TokenInterceptor(const std::string& value) : value_(value) {}

  void Intercept(grpcx::InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(
            grpcx::InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      methods->GetSendInitialMetadata()->insert({"authorization", value_});
    }
    methods->Proceed();
  }

 private:
  const std::string& value_;  // The factory's, which outlives its calls.
};

class TokenInterceptorFactory final : public grpcx::ClientInterceptorFactoryInterface {
 public:
  explicit TokenInterceptorFactory(const std::string& token)
      : value_(absl::StrCat("Bearer ", token)) {}
  grpcx::Interceptor* CreateClientInterceptor(grpcx::ClientRpcInfo*) override {
    return new TokenInterceptor(value_);
  }

 private:
  const std::string value_;
};

}  // namespace

bool StaysOnThisMachine(const std::string& target) {
  // An address, not a name that begins like one.
  const bool loopback = absl::StartsWith(target, "127.") &&
                        target.find_first_not_of("0123456789.:") == std::string::npos;
  return loopback || absl::StartsWith(target, "unix:") || absl::StartsWith(target, "localhost:") ||
         absl::StartsWith(target, "[::1]:");
}

absl::StatusOr<std::string> LoadToken(const std::string& path) {
  absl::StatusOr<std::string> text = ReadWhole(path, /*secret=*/true);
  if (!text.ok()) return text.status();
  const std::string token(absl::StripAsciiWhitespace(*text));
  if (token.empty() || token.find_first_of("\r\n") != std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat(path, " must hold one token"));
  }
  return token;
}

absl::Status CheckSecurity(const SecurityFiles& files, const std::string& target) {
  if (files.certificate.empty() != files.key.empty()) {
    return absl::InvalidArgumentError("a certificate and its key come together");
  }
  if (!files.token.empty() && !WantsTls(files) && !StaysOnThisMachine(target)) {
    return absl::InvalidArgumentError(
        absl::StrCat("the token would travel in the clear to ", target,
                     ": say by which authorities the server is known"));
  }
  return absl::OkStatus();
}

absl::StatusOr<Security> LoadSecurity(const SecurityFiles& files, const std::string& target) {
  absl::Status status = CheckSecurity(files, target);
  if (!status.ok()) return status;
  Security security;
  security.tls = WantsTls(files);
  status.Update(Load(files.ca, /*secret=*/false, &CheckCertificates, &security.ca));
  status.Update(
      Load(files.certificate, /*secret=*/false, &CheckCertificates, &security.certificate));
  status.Update(Load(files.key, /*secret=*/true, &CheckPrivateKey, &security.key));
  if (!status.ok()) return status;
  if (!files.key.empty() && !IsKeyOf(security.key, security.certificate)) {
    return absl::InvalidArgumentError(
        absl::StrCat(files.key, " is not the key of ", files.certificate));
  }
  if (files.token.empty()) return security;
  absl::StatusOr<std::string> token = LoadToken(files.token);
  if (!token.ok()) return token.status();
  security.token = *std::move(token);
  return security;
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target, const Security& security,
                                           const grpc::ChannelArguments& arguments) {
  grpc::ChannelArguments own = arguments;
  // gRPC would tunnel even to 127.0.0.1 through what http_proxy names, unless no_proxy says
  // otherwise: by another machine, and a token with it.
  if (StaysOnThisMachine(target)) own.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  const std::shared_ptr<grpc::ChannelCredentials> credentials =
      security.tls ? grpc::SslCredentials({.pem_root_certs = security.ca,
                                           .pem_private_key = security.key,
                                           .pem_cert_chain = security.certificate})
                   : grpc::InsecureChannelCredentials();
  std::vector<std::unique_ptr<grpcx::ClientInterceptorFactoryInterface>> interceptors;
  if (!security.token.empty()) {
    interceptors.push_back(std::make_unique<TokenInterceptorFactory>(security.token));
  }
  return grpcx::CreateCustomChannelWithInterceptors(target, credentials, own,
                                                    std::move(interceptors));
}

}  // namespace sightline::client
