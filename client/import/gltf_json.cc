// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_json.h"

#include <cmath>
#include <cstring>
#include <exception>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

using nlohmann::json;

constexpr uint64_t kMaxInt = std::numeric_limits<int32_t>::max();
constexpr uint64_t kMaxExact = uint64_t{1} << 53;  // Whole numbers that JSON carries exactly.

// Before parsing: nesting and an upper bound on the number of values.
absl::Status CheckJsonSize(std::string_view text) {
  int depth = 0;
  uint64_t values = 1;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') {
        ++i;
      } else if (c == '"') {
        in_string = false;
      }
      continue;
    }
    if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      ++values;
      if (++depth > kMaxJsonDepth) {
        return absl::ResourceExhaustedError(
            absl::StrCat("its JSON is nested deeper than ", kMaxJsonDepth, " levels"));
      }
    } else if (c == ']' || c == '}') {
      --depth;
    } else if (c == ',') {
      ++values;
    }
  }
  if (values > kMaxJsonValues) {
    return absl::ResourceExhaustedError(
        absl::StrCat("its JSON holds more than ", kMaxJsonValues, " values"));
  }
  return absl::OkStatus();
}

// The JSON chunk and the binary chunk of a GLB (version 2).
absl::Status SplitGlb(std::string_view bytes, std::string_view* text, std::string_view* bin) {
  const auto word = [&](size_t at) {
    uint32_t value;
    std::memcpy(&value, bytes.data() + at, sizeof(value));
    return value;
  };
  constexpr size_t kHeader = 12, kChunkHeader = 8;
  constexpr uint32_t kJson = 0x4E4F534A, kBin = 0x004E4942;
  if (bytes.size() < kHeader + kChunkHeader || bytes.substr(0, 4) != "glTF") {
    return absl::InvalidArgumentError("is no GLB file: it does not begin with \"glTF\"");
  }
  if (word(4) != 2) {
    return absl::UnimplementedError(
        absl::StrCat("is GLB version ", word(4), "; version 2 is read"));
  }
  if (word(8) > bytes.size()) {
    return absl::DataLossError(absl::StrCat("is cut short: its header says ", word(8),
                                            " bytes, the file has ", bytes.size()));
  }
  bytes = bytes.substr(0, word(8));
  bool first = true;
  for (size_t at = kHeader; bytes.size() >= at + kChunkHeader; first = false) {
    const uint64_t size = word(at);
    const uint32_t type = word(at + 4);
    at += kChunkHeader;
    if (size > bytes.size() - at)
      return absl::DataLossError("a chunk reaches past the end of the GLB");
    if (first != (type == kJson)) {
      return absl::InvalidArgumentError("its JSON chunk is not the first, or not the only one");
    }
    if (type == kJson) *text = bytes.substr(at, size);
    if (type == kBin && bin->empty()) *bin = bytes.substr(at, size);
    at += size;
  }
  if (first) return absl::InvalidArgumentError("the GLB holds no chunk");
  return absl::OkStatus();
}

// Copies what geometry needs from one document to another. The first complaint sticks.
class Filter {
 public:
  explicit Filter(const ImportOptions& options, MeshFormat format)
      : options_(options), format_(format) {}

  absl::StatusOr<json> Run(const json& in);
  std::vector<std::string> Warnings() const;
  std::vector<uint64_t> TakeFileLengths() { return std::move(file_lengths_); }

 private:
  void Fail(std::string_view where, std::string_view what) {
    if (status_.ok())
      status_ = absl::InvalidArgumentError(absl::StrCat(ToAbsl(where), " ", ToAbsl(what)));
  }

  void FailTooMany() {
    if (status_.ok()) {
      status_ = absl::ResourceExhaustedError(absl::StrCat(
          "lists more than ", kMaxGltfItems,
          " nodes, meshes, primitives, accessors, buffer views and buffers, the limit of a file: "
          "join meshes before it is exported, or cut it into several files"));
    }
  }

  // Copies in[key], where present, as a whole number of at most `most`.
  void CopyWhole(const json& in, const char* key, uint64_t most, json* out);
  // As finite numbers, `size` of them.
  void CopyNumbers(const json& in, const char* key, size_t size, json* out);
  void CopyString(const json& in, const char* key, json* out);
  // As whole numbers.
  void CopyIndexList(const json& in, const char* key, json* out);
  // Calls copy(item, &result) for the objects of the list in[key]; where_ names the item meanwhile.
  template <typename Copy>
  void CopyList(const json& in, const char* key, Copy copy, json* out);

  void CopyBuffer(const json& in, json* out);
  void CopyAccessor(const json& in, json* out);
  void CopyPrimitive(const json& in, json* out);
  void CopyNode(const json& in, json* out);
  void CheckExtensions(const json& in);

  const ImportOptions& options_;
  const MeshFormat format_;
  absl::Status status_;
  std::string where_;
  uint64_t items_ = 0, buffer_count_ = 0, buffer_bytes_ = 0;
  std::vector<uint64_t> file_lengths_;
  bool skins_or_targets_ = false, instancing_ = false;
};

// A whole number even where it was written as 3.0; empty for anything else.
std::optional<uint64_t> Whole(const json& value) {
  if (value.is_number_unsigned()) return value.get<uint64_t>();
  if (!value.is_number_float()) return std::nullopt;
  const double x = value.get<double>();
  if (!(x >= 0 && x <= static_cast<double>(kMaxExact)) || x != std::floor(x)) return std::nullopt;
  return static_cast<uint64_t>(x);
}

void Filter::CopyWhole(const json& in, const char* key, uint64_t most, json* out) {
  const auto it = in.find(key);
  if (it == in.end()) return;
  const std::optional<uint64_t> value = Whole(*it);
  if (!value.has_value() || *value > most) {
    Fail(absl::StrCat(where_, ".", key), absl::StrCat("is no whole number from 0 to ", most));
    return;
  }
  (*out)[key] = *value;
}

void Filter::CopyNumbers(const json& in, const char* key, size_t size, json* out) {
  const auto it = in.find(key);
  if (it == in.end()) return;
  bool fine = it->is_array() && it->size() == size;
  for (size_t i = 0; fine && i < size; ++i) {
    fine = (*it)[i].is_number() && std::isfinite((*it)[i].get<double>());
  }
  if (!fine) {
    Fail(absl::StrCat(where_, ".", key), absl::StrCat("is no list of ", size, " numbers"));
    return;
  }
  (*out)[key] = *it;
}

void Filter::CopyString(const json& in, const char* key, json* out) {
  const auto it = in.find(key);
  if (it != in.end() && it->is_string()) (*out)[key] = *it;
}

void Filter::CopyIndexList(const json& in, const char* key, json* out) {
  const auto it = in.find(key);
  if (it == in.end()) return;
  json list = json::array();
  bool fine = it->is_array();
  for (size_t i = 0; fine && i < it->size(); ++i) {
    const std::optional<uint64_t> value = Whole((*it)[i]);
    fine = value.has_value() && *value <= kMaxInt;
    if (fine) list.push_back(*value);
  }
  if (!fine) {
    Fail(absl::StrCat(where_, ".", key), "is no list of indices");
    return;
  }
  (*out)[key] = std::move(list);
}

template <typename Copy>
void Filter::CopyList(const json& in, const char* key, Copy copy, json* out) {
  const auto it = in.find(key);
  if (it == in.end()) return;
  const std::string outer = where_;
  const std::string list_name = outer.empty() ? std::string(key) : absl::StrCat(outer, ".", key);
  if (!it->is_array()) return Fail(list_name, "is no list");
  json list = json::array();
  for (size_t i = 0; i < it->size() && status_.ok(); ++i) {
    where_ = absl::StrCat(list_name, "[", i, "]");
    if (!(*it)[i].is_object()) return Fail(where_, "is no object");
    if (++items_ > kMaxGltfItems) return FailTooMany();
    json item = json::object();
    copy((*it)[i], &item);
    list.push_back(std::move(item));
  }
  where_ = outer;
  (*out)[key] = std::move(list);
}

// Digits of base64 that hold `bytes` bytes, whether padding follows or not.
uint64_t Base64Digits(uint64_t bytes) {
  const uint64_t left = bytes % 3;
  return bytes / 3 * 4 + (left == 0 ? 0 : left + 1);
}

void Filter::CopyBuffer(const json& in, json* out) {
  CopyWhole(in, "byteLength", kMaxExact, out);
  CopyString(in, "uri", out);
  const uint64_t number = buffer_count_++;
  if (!out->contains("byteLength")) return Fail(where_, "has no byteLength");
  // Every buffer becomes a copy of its bytes, so together they must keep to the limit.
  const uint64_t length = (*out)["byteLength"].get<uint64_t>();
  if (length == 0) return Fail(where_, "has a byteLength of 0; glTF asks for 1 or more");
  buffer_bytes_ += length;
  if (buffer_bytes_ > options_.max_file_bytes) {
    if (status_.ok()) {
      status_ = absl::ResourceExhaustedError(absl::StrCat(
          "its buffers claim more than the limit max_file_bytes, ", options_.max_file_bytes));
    }
    return;
  }
  if (!out->contains("uri")) {
    if (format_ != MeshFormat::kGlb || number != 0) Fail(where_, "has no uri");
    return;
  }
  // tinygltf knows a handful of media types and takes the rest for file names; only "base64"
  // matters.
  const std::string& uri = (*out)["uri"].get_ref<const std::string&>();
  constexpr std::string_view kBase64 = ";base64,";
  const size_t base64 = uri.find(kBase64);
  if (uri.starts_with("data:") && base64 != std::string::npos) {
    (*out)["uri"] =
        "data:application/octet-stream" + uri.substr(base64, kBase64.size() + Base64Digits(length));
  } else if (!uri.empty()) {  // Where it is, tinygltf takes a GLB's binary chunk.
    file_lengths_.push_back(length);
  }
}

void Filter::CopyAccessor(const json& in, json* out) {
  CopyWhole(in, "bufferView", kMaxInt, out);
  CopyWhole(in, "byteOffset", kMaxExact, out);
  CopyWhole(in, "componentType", kMaxInt, out);
  CopyWhole(in, "count", kMaxExact, out);
  CopyString(in, "type", out);
  if (const auto it = in.find("normalized"); it != in.end() && it->is_boolean()) {
    (*out)["normalized"] = *it;
  }
  const auto sparse = in.find("sparse");
  if (sparse == in.end()) return;
  if (!sparse->is_object()) return Fail(where_, "has a `sparse` that is no object");
  const std::string outer = where_;
  json copy = json::object();
  where_ = absl::StrCat(outer, ".sparse");
  CopyWhole(*sparse, "count", kMaxInt, &copy);
  for (const char* part : {"indices", "values"}) {
    where_ = absl::StrCat(outer, ".sparse.", part);
    const auto it = sparse->find(part);
    if (it == sparse->end() || !it->is_object()) return Fail(where_, "is missing");
    json copied = json::object();
    for (const char* key : {"bufferView", "byteOffset", "componentType"}) {
      CopyWhole(*it, key, kMaxInt, &copied);
    }
    copy[part] = std::move(copied);
  }
  where_ = outer;
  (*out)["sparse"] = std::move(copy);
}

void Filter::CopyPrimitive(const json& in, json* out) {
  CopyWhole(in, "indices", kMaxInt, out);
  CopyWhole(in, "mode", kMaxInt, out);
  skins_or_targets_ |= in.contains("targets");
  json attributes = json::object();
  if (const auto it = in.find("attributes"); it != in.end() && it->is_object()) {
    CopyWhole(*it, "POSITION", kMaxInt, &attributes);
  }
  (*out)["attributes"] = std::move(attributes);
}

void Filter::CopyNode(const json& in, json* out) {
  CopyString(in, "name", out);
  CopyWhole(in, "mesh", kMaxInt, out);
  CopyIndexList(in, "children", out);
  CopyNumbers(in, "matrix", 16, out);
  CopyNumbers(in, "rotation", 4, out);
  CopyNumbers(in, "scale", 3, out);
  CopyNumbers(in, "translation", 3, out);
  skins_or_targets_ |= in.contains("skin");
  if (const auto it = in.find("extensions"); it != in.end() && it->is_object()) {
    instancing_ |= it->contains("EXT_mesh_gpu_instancing");
  }
}

// A required extension that may change the geometry ends the import; one that only changes looks
// does not.
void Filter::CheckExtensions(const json& in) {
  const auto it = in.find("extensionsRequired");
  if (it == in.end() || !it->is_array()) return;
  for (const json& item : *it) {
    if (!item.is_string()) continue;
    const std::string& name = item.get_ref<const std::string&>();
    bool harmless = name == "KHR_mesh_quantization";
    for (const std::string_view looks : {"KHR_materials_", "KHR_texture_", "EXT_texture_",
                                         "MSFT_texture_", "KHR_lights_", "KHR_xmp"}) {
      harmless |= name.starts_with(looks);
    }
    if (!harmless && status_.ok()) {
      status_ = absl::UnimplementedError(
          absl::StrCat("requires the extension ", Quoted(name), ", which is not read"));
    }
  }
}

absl::StatusOr<json> Filter::Run(const json& in) {
  if (!in.is_object()) return absl::InvalidArgumentError("its JSON is no object");
  CheckExtensions(in);
  json out = json::object();
  out["asset"] = {{"version", "2.0"}};
  const auto asset = in.find("asset");
  if (asset == in.end() || !asset->is_object() || !asset->contains("version")) {
    Fail("asset.version", "is missing: this is no glTF file");
  } else if (const json& version = (*asset)["version"];
             !version.is_string() || !version.get_ref<const std::string&>().starts_with("2.")) {
    if (status_.ok()) status_ = absl::UnimplementedError("is no glTF of version 2");
  }
  CopyWhole(in, "scene", kMaxInt, &out);
  CopyList(
      in, "scenes", [this](const json& i, json* o) { CopyIndexList(i, "nodes", o); }, &out);
  CopyList(
      in, "nodes", [this](const json& i, json* o) { CopyNode(i, o); }, &out);
  CopyList(
      in, "meshes",
      [this](const json& mesh, json* o) {
        CopyString(mesh, "name", o);
        CopyList(
            mesh, "primitives", [this](const json& p, json* q) { CopyPrimitive(p, q); }, o);
      },
      &out);
  CopyList(
      in, "accessors", [this](const json& i, json* o) { CopyAccessor(i, o); }, &out);
  CopyList(
      in, "bufferViews",
      [this](const json& i, json* o) {
        CopyWhole(i, "buffer", kMaxInt, o);
        for (const char* key : {"byteOffset", "byteLength", "byteStride"}) {
          CopyWhole(i, key, kMaxExact, o);
        }
      },
      &out);
  CopyList(
      in, "buffers", [this](const json& i, json* o) { CopyBuffer(i, o); }, &out);
  if (!status_.ok()) return status_;
  return out;
}

std::vector<std::string> Filter::Warnings() const {
  std::vector<std::string> warnings;
  if (skins_or_targets_) {
    warnings.emplace_back(
        "skins and morph targets are not applied: the mesh stands as it was modelled");
  }
  if (instancing_)
    warnings.emplace_back("EXT_mesh_gpu_instancing is not applied: one instance stands");
  return warnings;
}

}  // namespace

absl::StatusOr<GltfSource> PrepareGltf(std::string_view bytes, MeshFormat format,
                                       const ImportOptions& options) {
  GltfSource source;
  std::string_view text = bytes;
  if (format == MeshFormat::kGlb) SL_RETURN_IF_ERROR(SplitGlb(bytes, &text, &source.bin));
  SL_RETURN_IF_ERROR(CheckJsonSize(text));
  Filter filter(options, format);
  try {
    SL_ASSIGN_OR_RETURN(const json filtered, filter.Run(json::parse(text)));
    source.json = filtered.dump(-1, ' ', false, json::error_handler_t::replace);
  } catch (const json::exception& e) {  // The one boundary for the JSON library.
    return absl::InvalidArgumentError(absl::StrCat("its JSON is malformed: ", Quoted(e.what())));
  }
  source.file_lengths = filter.TakeFileLengths();
  source.warnings = filter.Warnings();
  return source;
}

}  // namespace sightline
