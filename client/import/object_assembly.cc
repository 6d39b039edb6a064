// SPDX-License-Identifier: Apache-2.0
#include "client/import/object_assembly.h"

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "client/import/text_scanner.h"
#include "core/base/utf8.h"

namespace sightline {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD.

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
    const size_t size = Utf8CharacterSize({raw.data(), raw.size()});
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
