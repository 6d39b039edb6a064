// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_model.h"

#include <cstring>
#include <exception>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/import/file_bytes.h"
#include "client/import/text_scanner.h"
#include "client/import/tinygltf_api.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// The files of a document's buffers, which tinygltf reads in the document's order, each once.
struct BufferFiles {
  const ImportOptions& options;
  const std::vector<uint64_t>& lengths;  // GltfSource::file_lengths.
  size_t next = 0;
  uint64_t bytes = 0;  // Of those that have been read.
};

// Where a buffer's file lies; empty where it would leave the base folder.
std::string BufferPath(const std::string& uri, const ImportOptions& options) {
  const std::filesystem::path relative(uri);
  if (options.base_folder.empty() || uri.empty() || relative.is_absolute()) return {};
  for (const std::filesystem::path& part : relative) {
    if (part == "..") return {};
  }
  return (std::filesystem::path(options.base_folder) / relative).string();
}

// A file as long as its buffer says, or shorter, for tinygltf to refuse: it compares for equality,
// and glTF lets a file go on. Together the files must keep to the limit, as what the buffers claim
// of them does: any number of buffers may name a long one.
absl::StatusOr<std::string> ReadBufferFile(const std::string& uri, BufferFiles* files) {
  const ImportOptions& options = files->options;
  if (files->next == files->lengths.size()) {
    return absl::InternalError("tinygltf reads more files than there are buffers in files");
  }
  absl::StatusOr<std::string> bytes = ReadFileBytes(
      BufferPath(uri, options), options.max_file_bytes - files->bytes, options.cancel);
  if (files->bytes > 0 && absl::IsResourceExhausted(bytes.status())) {
    return absl::ResourceExhaustedError(absl::StrCat("is past the limit max_file_bytes, ",
                                                     options.max_file_bytes,
                                                     ", with the buffers before it"));
  }
  const uint64_t length = files->lengths[files->next++];
  if (!bytes.ok()) return bytes;
  files->bytes += bytes->size();
  if (bytes->size() > length) bytes->resize(length);
  return bytes;
}

// tinygltf's own file access searches the working folder too and expands names as a shell would.
sightline_tinygltf::FsCallbacks ConfinedFiles(BufferFiles* files) {
  sightline_tinygltf::FsCallbacks fs;
  fs.user_data = files;
  fs.ExpandFilePath = [](const std::string& uri, void*) { return uri; };
  fs.FileExists = [](const std::string& uri, void* user) {
    std::error_code error;
    const std::string path = BufferPath(uri, static_cast<BufferFiles*>(user)->options);
    return !path.empty() && std::filesystem::is_regular_file(path, error);
  };
  fs.ReadWholeFile = [](std::vector<unsigned char>* out, std::string* error, const std::string& uri,
                        void* user) {
    const absl::StatusOr<std::string> bytes = ReadBufferFile(uri, static_cast<BufferFiles*>(user));
    if (!bytes.ok()) {
      *error = std::string(bytes.status().message());
      return false;
    }
    out->assign(bytes->begin(), bytes->end());
    return true;
  };
  fs.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&,
                         void*) { return false; };
  return fs;
}

// A GLB anew, from the filtered JSON and the binary chunk: consistent whatever the file was.
std::vector<unsigned char> MakeGlb(const GltfSource& source) {
  const auto padded = [](size_t size) { return (size + 3) / 4 * 4; };
  const size_t json_size = padded(source.json.size());
  const size_t bin_size = padded(source.bin.size());
  const size_t total = 20 + json_size + (bin_size == 0 ? 0 : 8 + bin_size);
  std::vector<unsigned char> glb(total, 0);
  const auto put = [&glb](size_t at, size_t value) {
    const uint32_t word = static_cast<uint32_t>(value);
    std::memcpy(glb.data() + at, &word, sizeof(word));
  };
  std::memcpy(glb.data(), "glTF", 4);
  put(4, 2);
  put(8, total);
  put(12, json_size);
  put(16, 0x4E4F534A);  // "JSON"
  std::memset(glb.data() + 20, ' ', json_size);
  std::memcpy(glb.data() + 20, source.json.data(), source.json.size());
  if (bin_size != 0) {
    const size_t at = 20 + json_size;
    put(at, bin_size);
    put(at + 4, 0x004E4942);  // "BIN"
    std::memcpy(glb.data() + at + 8, source.bin.data(), source.bin.size());
  }
  return glb;
}

std::string OneLine(std::string text) {
  for (char& c : text) {
    if (IsLineEnd(c)) c = ' ';
  }
  return Quoted(TrimBlanks(text));
}

}  // namespace

absl::Status ParseGltf(const GltfSource& source, MeshFormat format, const ImportOptions& options,
                       sightline_tinygltf::Model* model) {
  // tinygltf counts in 32 bits.
  constexpr size_t kMost = std::numeric_limits<uint32_t>::max() - 64;
  if (source.json.size() > kMost || source.bin.size() > kMost - source.json.size()) {
    return absl::ResourceExhaustedError("is larger than 4 GiB, which glTF's reader cannot take");
  }
  std::string error, warning;
  bool parsed = false;
  try {
    BufferFiles files{.options = options, .lengths = source.file_lengths};
    sightline_tinygltf::TinyGLTF reader;
    reader.SetFsCallbacks(ConfinedFiles(&files));
    if (format == MeshFormat::kGlb) {
      const std::vector<unsigned char> glb = MakeGlb(source);
      parsed = reader.LoadBinaryFromMemory(model, &error, &warning, glb.data(),
                                           static_cast<unsigned int>(glb.size()), "");
    } else {
      parsed = reader.LoadASCIIFromString(model, &error, &warning, source.json.data(),
                                          static_cast<unsigned int>(source.json.size()), "");
    }
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("needs more memory than there is");
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("is malformed glTF: ", OneLine(e.what())));
  }
  SL_RETURN_IF_ERROR(CheckWanted(options.cancel, 0));  // Which tinygltf has another word for.
  if (!parsed) {
    return absl::InvalidArgumentError(
        absl::StrCat("is malformed glTF: ", OneLine(std::move(error))));
  }
  return absl::OkStatus();
}

}  // namespace sightline
