// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_request.h"

#include <algorithm>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace sightline {
namespace {

using State = HttpHead::State;

// Takes the next line off, without its end; false where it has none yet.
bool TakeLine(absl::string_view* bytes, absl::string_view* line) {
  const size_t end = bytes->find('\n');
  if (end == absl::string_view::npos) return false;
  *line = absl::StripSuffix(bytes->substr(0, end), "\r");
  bytes->remove_prefix(end + 1);
  return true;
}

// Whether all are characters that a line may have.
bool IsText(absl::string_view line) {
  return std::all_of(line.begin(), line.end(), [](char c) {
    return c == '\t' || !absl::ascii_iscntrl(static_cast<unsigned char>(c));
  });
}

// "GET /livez HTTP/1.1".
bool ReadFirstLine(absl::string_view line, HttpHead* head) {
  const std::vector<absl::string_view> words = absl::StrSplit(line, ' ');
  if (words.size() != 3 || words[0].empty()) return false;
  if (words[2] != "HTTP/1.1" && words[2] != "HTTP/1.0") return false;
  absl::string_view target = words[1];
  if (absl::ConsumePrefix(&target, "http://")) {
    const size_t slash = target.find('/');
    target = slash == absl::string_view::npos ? "/" : target.substr(slash);
  }
  head->method = std::string(words[0]);
  head->path = std::string(target.substr(0, target.find('?')));
  return true;
}

// False for a line that is none, and for a second Authorization: nobody knows which one counts.
bool ReadHeader(absl::string_view line, bool* authorized, HttpRequest* request) {
  const size_t colon = line.find(':');
  if (colon == absl::string_view::npos || colon == 0) return false;
  // Lines that go on below are long out of use, and were always ambiguous.
  if (line.find_first_of(" \t") < colon) return false;
  if (!absl::EqualsIgnoreCase(line.substr(0, colon), "authorization")) return true;
  if (*authorized) return false;
  *authorized = true;
  request->authorization = std::string(absl::StripAsciiWhitespace(line.substr(colon + 1)));
  return true;
}

}  // namespace

HttpHead ReadHttpHead(absl::string_view bytes) {
  HttpHead head;
  absl::string_view rest = bytes, line;
  bool first = true, authorized = false;
  while (TakeLine(&rest, &line)) {
    if (bytes.size() - rest.size() > kMostHeadBytes) break;
    if (line.empty() && !first) {
      head.state = State::kWhole;
      return head;
    }
    if (!IsText(line) ||
        !(first ? ReadFirstLine(line, &head) : ReadHeader(line, &authorized, &head.request))) {
      head.state = State::kBad;
      return head;
    }
    first = false;
  }
  if (bytes.size() > kMostHeadBytes) head.state = State::kBad;
  return head;
}

}  // namespace sightline
