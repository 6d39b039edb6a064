// SPDX-License-Identifier: Apache-2.0
#include "client/import/object_assembly.h"

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "client/import/text_scanner.h"

namespace sightline {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD.

// Bytes of the well-formed UTF-8 character at the front of `text`; 0 where there is none (Unicode
// 15, table 3-7: no overlong forms, no surrogates, nothing above U+10FFFF).
size_t Utf8CharacterSize(std::string_view text) {
  const auto byte = [&](size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u;
  };
  const auto in = [&](size_t i, unsigned lo, unsigned hi) {
    return byte(i) >= lo && byte(i) <= hi;
  };
  const auto tail = [&](size_t i) { return in(i, 0x80, 0xBF); };
  if (in(0, 0x00, 0x7F)) return 1;
  if (in(0, 0xC2, 0xDF) && tail(1)) return 2;
  const bool three = in(0, 0xE0, 0xE0)   ? in(1, 0xA0, 0xBF)
                     : in(0, 0xED, 0xED) ? in(1, 0x80, 0x9F)
                                         : in(0, 0xE1, 0xEF) && tail(1);
  if (three && tail(2)) return 3;
  const bool four = in(0, 0xF0, 0xF0)   ? in(1, 0x90, 0xBF)
                    : in(0, 0xF4, 0xF4) ? in(1, 0x80, 0x8F)
                                        : in(0, 0xF1, 0xF3) && tail(1);
  if (four && tail(2) && tail(3)) return 4;
  return 0;
}

}  // namespace

ObjectInput VertexCompactor::MakeObject(std::string name, std::span<const uint32_t> indices) {
  if (slots_.empty()) slots_.resize(pool_->size());
  ++objects_;
  ObjectInput object;
  object.name = std::move(name);
  object.indices.reserve(indices.size());
  for (const uint32_t v : indices) {
    Slot& slot = slots_[v];
    if (slot.object != objects_) {
      slot = {objects_, static_cast<uint32_t>(object.vertices.size())};
      object.vertices.push_back((*pool_)[v]);
    }
    object.indices.push_back(slot.local);
  }
  object.vertices.shrink_to_fit();
  return object;
}

std::string CleanName(std::string_view raw) {
  raw = TrimBlanks(raw);
  std::string name;
  while (!raw.empty()) {
    const size_t size = Utf8CharacterSize(raw);
    const unsigned char first = static_cast<unsigned char>(raw.front());
    const bool control = size == 1 && (first < 0x20 || first == 0x7F);
    const std::string_view next = size == 0 || control ? kReplacement : raw.substr(0, size);
    if (name.size() + next.size() > kMaxNameBytes) break;
    name.append(next);
    raw.remove_prefix(size == 0 ? 1 : size);
  }
  return name;
}

void FinishNames(std::string_view fallback, std::vector<ObjectInput>* objects) {
  std::string nameless = CleanName(fallback);
  if (nameless.empty()) nameless = "mesh";
  absl::flat_hash_set<std::string> taken;
  for (ObjectInput& object : *objects) {
    object.name = CleanName(object.name);
    if (object.name.empty()) object.name = nameless;
    taken.insert(object.name);
  }
  // The first of each name keeps it; the others get the next number that no object of the file
  // bears.
  absl::flat_hash_map<std::string, uint64_t> last_number;
  for (ObjectInput& object : *objects) {
    uint64_t& number = last_number[object.name];
    if (++number == 1) continue;
    std::string numbered = absl::StrCat(object.name, " (", number, ")");
    while (!taken.insert(numbered).second) {
      numbered = absl::StrCat(object.name, " (", ++number, ")");
    }
    object.name = std::move(numbered);
  }
}

}  // namespace sightline
