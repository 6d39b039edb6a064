// SPDX-License-Identifier: Apache-2.0
#include "server/services/unary.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "server/base/resource_name.h"

namespace sightline {
namespace {

constexpr int32_t kDefaultPageSize = 100;
constexpr int32_t kMaxPageSize = 1000;
constexpr char kTokenPrefix = '~';  // In no id, so that an id is no token.

}  // namespace

absl::StatusOr<Page> ParsePage(int32_t page_size, const std::string& page_token) {
  if (page_size < 0) return InvalidField("page_size", page_size, "must not be negative");
  Page page;
  page.size = page_size == 0 ? kDefaultPageSize : std::min(page_size, kMaxPageSize);
  if (page_token.empty()) return page;
  page.after = page_token.substr(1);
  if (page_token[0] != kTokenPrefix || !CheckId("page_token", page.after).ok()) {
    return InvalidField("page_token", absl::StrCat(page_token.size(), " bytes"),
                        "is not a token of an earlier page");
  }
  return page;
}

std::string PageToken(const std::string& last_id) { return absl::StrCat("~", last_id); }

}  // namespace sightline
