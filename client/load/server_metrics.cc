// SPDX-License-Identifier: Apache-2.0
#include "client/load/server_metrics.h"

#include <curl/curl.h>

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/exit_code.h"
#include "client/cli/session.h"
#include "client/lib/security.h"

namespace sightline::load {
namespace {

constexpr size_t kMostBytes = size_t{64} << 20;

// libcurl's callback; anything but `size * count` ends the transfer.
size_t Append(char* data, size_t size, size_t count, void* text) {
  std::string& out = *static_cast<std::string*>(text);
  if (out.size() + size * count > kMostBytes) return 0;
  out.append(data, size * count);
  return size * count;
}

// Where the name and its labels end: labels may hold blanks and, escaped, quotes.
size_t EndOfName(absl::string_view line) {
  bool quoted = false, labels = false;
  for (size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted && c == '\\') {
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (!quoted && c == '{') {
      labels = true;
    } else if (!quoted && c == '}') {
      return i + 1;
    } else if (!labels && (c == ' ' || c == '\t')) {
      return i;
    }
  }
  return absl::string_view::npos;
}

bool StaysOnThisMachine(absl::string_view url) {
  if (!absl::ConsumePrefix(&url, "https://")) absl::ConsumePrefix(&url, "http://");
  const std::string host = absl::StrCat(url.substr(0, url.find_first_of("/?#")), ":");
  // Before an @ there is a user's name, and a machine may be called unix.
  return !absl::StrContains(host, '@') && !absl::StartsWith(host, "unix:") &&
         client::StaysOnThisMachine(host);
}

}  // namespace

absl::StatusOr<Metrics> ParseMetrics(absl::string_view text) {
  Metrics metrics;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    const size_t end = EndOfName(line);
    // Behind the value there may be a time.
    const std::vector<absl::string_view> words =
        end == absl::string_view::npos
            ? std::vector<absl::string_view>()
            : absl::StrSplit(line.substr(end), absl::ByAnyChar(" \t"), absl::SkipEmpty());
    double value = 0;
    if (end == 0 || words.empty() || words.size() > 2 || !absl::SimpleAtod(words[0], &value)) {
      return absl::InvalidArgumentError(absl::StrCat(
          "line ", number, " of the metrics is no sample: '", line.substr(0, 80), "'"));
    }
    metrics[std::string(line.substr(0, end))] = value;
  }
  return metrics;
}

std::string MetricsUrl(const std::string& where) {
  return absl::StrContains(where, "://") ? where : absl::StrCat("http://", where, "/metrics");
}

absl::StatusOr<std::string> MetricsToken(const std::string& path, const std::string& where) {
  if (path.empty()) return std::string();
  const std::string url = MetricsUrl(where);
  if (!absl::StartsWith(url, "https://") && !StaysOnThisMachine(url)) {
    return cli::UsageError(
        absl::StrCat("--metrics-token-file: the token would travel in the clear to ", url,
                     ": give an https:// URL, or read the metrics on the server's machine"));
  }
  absl::StatusOr<std::string> token = client::LoadToken(path);
  if (!token.ok()) return cli::SecurityFileError(token.status());
  return token;
}

absl::StatusOr<Metrics> ReadMetrics(const std::string& where, const std::string& token,
                                    absl::Duration timeout) {
  static const bool initialized = curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
  const std::unique_ptr<CURL, void (*)(CURL*)> curl(initialized ? curl_easy_init() : nullptr,
                                                    curl_easy_cleanup);
  if (curl == nullptr) return absl::InternalError("libcurl cannot be used");
  const std::string url = MetricsUrl(where);
  std::string text;
  curl_easy_setopt(curl.get(), CURLOPT_URL, url.c_str());
  curl_easy_setopt(curl.get(), CURLOPT_PROTOCOLS_STR, "http,https");
  // A proxy would ask another machine for what is on this one, and show it the token.
  if (StaysOnThisMachine(url)) curl_easy_setopt(curl.get(), CURLOPT_NOPROXY, "*");
  curl_easy_setopt(curl.get(), CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl.get(), CURLOPT_TIMEOUT_MS, absl::ToInt64Milliseconds(timeout));
  curl_easy_setopt(curl.get(), CURLOPT_WRITEFUNCTION, Append);
  curl_easy_setopt(curl.get(), CURLOPT_WRITEDATA, &text);
  const std::unique_ptr<curl_slist, void (*)(curl_slist*)> headers(
      token.empty()
          ? nullptr
          : curl_slist_append(nullptr, absl::StrCat("Authorization: Bearer ", token).c_str()),
      curl_slist_free_all);
  curl_easy_setopt(curl.get(), CURLOPT_HTTPHEADER, headers.get());
  const CURLcode code = curl_easy_perform(curl.get());
  if (code == CURLE_WRITE_ERROR) {
    return absl::ResourceExhaustedError(
        absl::StrCat(url, " has more than ", kMostBytes, " bytes of metrics"));
  }
  if (code != CURLE_OK) {
    return absl::UnavailableError(absl::StrCat("metrics of ", url, ": ", curl_easy_strerror(code)));
  }
  long status = 0;
  curl_easy_getinfo(curl.get(), CURLINFO_RESPONSE_CODE, &status);
  if (status != 200) {
    const bool refused = status == 401 || status == 403;
    return absl::UnavailableError(absl::StrCat(
        "metrics of ", url, ": HTTP status ", status,
        refused ? ": give a token with the role metrics by --metrics-token-file" : ""));
  }
  return ParseMetrics(text);
}

std::map<std::string, MetricChange> ChangedMetrics(const Metrics& before, const Metrics& after) {
  std::map<std::string, MetricChange> changes;
  for (const auto& [name, value] : after) {
    if (absl::StartsWith(name, "process_") || absl::StartsWith(name, "go_") ||
        absl::StrContains(name, "_bucket{")) {
      continue;
    }
    const auto found = before.find(name);
    const double was = found == before.end() ? 0 : found->second;
    if (was != value) changes[name] = {was, value};
  }
  return changes;
}

}  // namespace sightline::load
