// SPDX-License-Identifier: Apache-2.0
#include "server/auth/access_policy.h"

#include <openssl/crypto.h>
#include <openssl/sha.h>

#include <algorithm>
#include <iterator>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"
#include "server/auth/secret_file.h"

namespace sightline {
namespace {

constexpr size_t kLeastTokenLength = 16;

struct LimitName {
  absl::string_view name;
  uint64_t CallerLimits::*limit;
};
constexpr LimitName kLimitNames[] = {{"rays", &CallerLimits::rays},
                                     {"streams", &CallerLimits::streams},
                                     {"uploads", &CallerLimits::uploads},
                                     {"upload-bytes", &CallerLimits::upload_bytes},
                                     {"scenes", &CallerLimits::scenes}};

absl::Status Bad(absl::string_view what) { return absl::InvalidArgumentError(what); }

// "*.example.org" fits "a.example.org" and neither "example.org" nor "a.b.example.org".
bool Fits(absl::string_view pattern, absl::string_view name) {
  if (!absl::ConsumePrefix(&pattern, "*.")) return pattern == name;
  const size_t dot = name.find('.');
  return dot != absl::string_view::npos && dot > 0 && name.substr(dot + 1) == pattern;
}

}  // namespace

AccessPolicy::Digest AccessPolicy::Hash(absl::string_view text) {
  Digest digest;
  SHA256(reinterpret_cast<const uint8_t*>(text.data()), text.size(), digest.data());
  return digest;
}

absl::Status AccessPolicy::AddToken(RoleSet roles, absl::string_view name,
                                    absl::string_view secret) {
  Token token{.name = std::string(name), .digest = {}, .roles = roles};
  if (absl::ConsumePrefix(&secret, "plain:")) {
    if (secret.size() < kLeastTokenLength) {
      return Bad(absl::StrCat("token ", name, ": has fewer than ", kLeastTokenLength,
                              " characters, which can be guessed"));
    }
    token.digest = Hash(secret);
  } else if (absl::ConsumePrefix(&secret, "sha256:")) {
    const bool hex = secret.size() == 2 * token.digest.size() &&
                     std::all_of(secret.begin(), secret.end(), absl::ascii_isxdigit);
    if (!hex) return Bad(absl::StrCat("token ", name, ": sha256: wants 64 hexadecimal digits"));
    const std::string bytes = absl::HexStringToBytes(secret);
    std::copy(bytes.begin(), bytes.end(), token.digest.begin());
  } else {
    return Bad(absl::StrCat("token ", name, ": wants sha256:HEX or plain:TEXT"));
  }
  for (const Token& other : tokens_) {
    if (other.name == token.name || other.digest == token.digest) {
      return Bad(absl::StrCat("token ", name, ": is there already, as ", other.name));
    }
  }
  tokens_.push_back(std::move(token));
  return absl::OkStatus();
}

absl::Status AccessPolicy::AddLimit(absl::string_view role, absl::string_view what,
                                    absl::string_view number) {
  SL_ASSIGN_OR_RETURN(const RoleSet roles, ParseRoles(role));
  const auto* const limit = std::find_if(std::begin(kLimitNames), std::end(kLimitNames),
                                         [&](const LimitName& each) { return each.name == what; });
  if (limit == std::end(kLimitNames)) {
    return Bad(absl::StrCat("limit ", role, ": there are limits of rays, streams, uploads, ",
                            "upload-bytes and scenes, not of \"", what, "\""));
  }
  uint64_t most = 0;
  if (!absl::SimpleAtoi(number, &most) || most == 0) {
    return Bad(absl::StrCat("limit ", role, ": \"", number, "\" must be a number of ", what,
                            ", 1 or more"));
  }
  for (const RoleSet each : {kQueryRole, kAdminRole, kMetricsRole}) {
    if ((roles & each) != 0) limits_[each].*limit->limit = most;
  }
  return absl::OkStatus();
}

CallerLimits AccessPolicy::LimitsOf(RoleSet roles) const {
  CallerLimits most;
  for (const auto& [role, limits] : limits_) {
    if ((roles & role) == 0) continue;
    for (const LimitName& each : kLimitNames) {
      most.*each.limit = std::max(most.*each.limit, limits.*each.limit);
    }
  }
  return most;
}

absl::Status AccessPolicy::AddLine(const std::vector<absl::string_view>& words) {
  constexpr absl::string_view kForm =
      "must be ROLES cert NAME, ROLES token NAME sha256:HEX|plain:TEXT, ROLES unix, or limit ROLE "
      "rays|streams|uploads|upload-bytes|scenes N";
  if (words.size() < 2) return Bad(kForm);
  if (words[0] == "limit") {
    return words.size() == 4 ? AddLimit(words[1], words[2], words[3]) : Bad(kForm);
  }
  SL_ASSIGN_OR_RETURN(const RoleSet roles, ParseRoles(words[0]));
  if (words[1] == "unix" && words.size() == 2) {
    unix_roles_ |= roles;
    return absl::OkStatus();
  }
  if (words[1] == "cert" && words.size() == 3) {
    certificates_.push_back({std::string(words[2]), roles});
    return absl::OkStatus();
  }
  if (words[1] == "token" && words.size() == 4) return AddToken(roles, words[2], words[3]);
  return Bad(kForm);
}

absl::StatusOr<AccessPolicy> AccessPolicy::Parse(absl::string_view name, absl::string_view text) {
  AccessPolicy policy;
  int line_number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++line_number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    const std::vector<absl::string_view> words =
        absl::StrSplit(line, absl::ByAnyChar(" \t"), absl::SkipEmpty());
    if (const absl::Status status = policy.AddLine(words); !status.ok()) {
      return Bad(absl::StrCat(name, ":", line_number, ": ", status.message()));
    }
  }
  return policy;
}

absl::StatusOr<AccessPolicy> AccessPolicy::Read(const std::string& path) {
  SL_ASSIGN_OR_RETURN(const std::string text, ReadSecretFile(path));
  return Parse(path, text);
}

std::optional<Caller> AccessPolicy::ByToken(absl::string_view token) const {
  const Digest digest = Hash(token);
  const Token* found = nullptr;
  for (const Token& known : tokens_) {
    if (CRYPTO_memcmp(known.digest.data(), digest.data(), digest.size()) == 0) found = &known;
  }
  if (found == nullptr) return std::nullopt;
  return Caller{.name = absl::StrCat("token:", found->name), .roles = found->roles};
}

std::optional<Caller> AccessPolicy::ByCertificate(const std::vector<std::string>& names) const {
  Caller caller;
  for (const Certificate& known : certificates_) {
    const auto name = std::find_if(names.begin(), names.end(), [&](const std::string& each) {
      return Fits(known.pattern, each);
    });
    if (name == names.end()) continue;
    if (caller.name.empty()) caller.name = absl::StrCat("cert:", *name);
    caller.roles |= known.roles;
  }
  if (caller.name.empty()) return std::nullopt;
  return caller;
}

std::optional<Caller> AccessPolicy::Identify(const Shown& shown) const {
  std::optional<Caller> caller = Recognize(shown);
  if (caller.has_value()) caller->limits = LimitsOf(caller->roles);
  return caller;
}

std::optional<Caller> AccessPolicy::Recognize(const Shown& shown) const {
  if (shown.authorizations.size() > 1) return std::nullopt;
  if (!shown.authorizations.empty() && !shown.authorizations[0].empty()) {
    absl::string_view token = shown.authorizations[0];
    const size_t blank = token.find(' ');
    if (blank == absl::string_view::npos ||
        !absl::EqualsIgnoreCase(token.substr(0, blank), "bearer")) {
      return std::nullopt;
    }
    return ByToken(absl::StripAsciiWhitespace(token.substr(blank)));
  }
  if (std::optional<Caller> caller = ByCertificate(shown.certificate_names)) return caller;
  if (shown.through_unix_socket && unix_roles_ != kNoRole) {
    return Caller{.name = "unix", .roles = unix_roles_};
  }
  return std::nullopt;
}

}  // namespace sightline
