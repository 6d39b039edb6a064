// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_accessor.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "client/import/tinygltf_api.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Bytes of a component; 0 for a type that glTF does not have. (Double is tinygltf's own, and
// harmless.)
size_t ComponentSize(int type) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return 4;
    case TINYGLTF_COMPONENT_TYPE_DOUBLE:
      return 8;
    default:
      return 0;
  }
}

bool IsIndexType(int type) {
  return type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
         type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
         type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
}

template <typename T>
T Load(const uint8_t* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

uint64_t LoadIndex(int type, const uint8_t* at) {
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) return *at;
  if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) return Load<uint16_t>(at);
  return Load<uint32_t>(at);
}

}  // namespace

uint64_t BufferBytes(const sightline_tinygltf::Model& model) {
  uint64_t bytes = 0;
  for (const sightline_tinygltf::Buffer& buffer : model.buffers) bytes += buffer.data.size();
  return bytes;
}

absl::StatusOr<GltfAccessor::Run> GltfAccessor::OpenRun(const sightline_tinygltf::Model& model,
                                                        int view_number, uint64_t offset,
                                                        uint64_t count, size_t element_size,
                                                        bool may_stride) {
  if (view_number < 0 || static_cast<size_t>(view_number) >= model.bufferViews.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("names bufferView ", view_number, " of ", model.bufferViews.size()));
  }
  const sightline_tinygltf::BufferView& view = model.bufferViews[view_number];
  if (view.buffer < 0 || static_cast<size_t>(view.buffer) >= model.buffers.size()) {
    return absl::InvalidArgumentError(absl::StrCat("bufferView ", view_number, " names buffer ",
                                                   view.buffer, " of ", model.buffers.size()));
  }
  const std::vector<unsigned char>& buffer = model.buffers[view.buffer].data;
  if (view.byteOffset > buffer.size() || view.byteLength > buffer.size() - view.byteOffset) {
    return absl::InvalidArgumentError(
        absl::StrCat("bufferView ", view_number, " reaches past the end of its buffer"));
  }
  const size_t stride = may_stride && view.byteStride != 0 ? view.byteStride : element_size;
  if (stride < element_size) {
    return absl::InvalidArgumentError(absl::StrCat("bufferView ", view_number, " has the stride ",
                                                   stride, " for elements of ", element_size,
                                                   " bytes"));
  }
  // offset + (count - 1) stride + element_size <= byteLength, without overflow.
  const uint64_t length = view.byteLength;
  if (count > 0 && (offset > length || length - offset < element_size ||
                    (length - offset - element_size) / stride < count - 1)) {
    return absl::InvalidArgumentError(absl::StrCat("claims ", count, " elements at ", offset,
                                                   ", more than bufferView ", view_number,
                                                   " holds in its ", length, " bytes"));
  }
  return Run{buffer.data() + view.byteOffset + (count > 0 ? offset : 0), stride};
}

absl::StatusOr<GltfAccessor> GltfAccessor::Open(const sightline_tinygltf::Model& model, int number,
                                                uint64_t buffer_bytes) {
  if (number < 0 || static_cast<size_t>(number) >= model.accessors.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("a primitive names accessor ", number, " of ", model.accessors.size()));
  }
  const sightline_tinygltf::Accessor& in = model.accessors[number];
  const auto named = [number](const absl::Status& status) {
    return absl::Status(status.code(), absl::StrCat("accessor ", number, " ", status.message()));
  };
  GltfAccessor out;
  out.number_ = number;
  out.component_type_ = in.componentType;
  out.components_ = in.type == TINYGLTF_TYPE_SCALAR ? 1 : in.type == TINYGLTF_TYPE_VEC3 ? 3 : 0;
  out.normalized_ = in.normalized;
  out.count_ = in.count;
  const size_t element_size = out.components_ * ComponentSize(in.componentType);
  if (element_size == 0) {
    return named(absl::InvalidArgumentError("has a type that holds neither indices nor positions"));
  }
  if (in.bufferView >= 0) {
    absl::StatusOr<Run> base = OpenRun(model, in.bufferView, in.byteOffset, in.count, element_size,
                                       /*may_stride=*/true);
    if (!base.ok()) return named(base.status());
    out.base_ = *base;
  } else {
    // All zero but for its sparse elements. No bytes stand behind its count, so hold it against all
    // that the file has: a count beyond that cannot be meant.
    if (!in.sparse.isSparse || in.count > buffer_bytes) {
      return named(absl::InvalidArgumentError(
          absl::StrCat("has no bufferView for its ", in.count, " elements")));
    }
  }
  if (!in.sparse.isSparse) return out;

  const auto& sparse = in.sparse;
  if (sparse.count < 0 || static_cast<uint64_t>(sparse.count) > in.count ||
      sparse.indices.byteOffset < 0 || sparse.values.byteOffset < 0 ||
      !IsIndexType(sparse.indices.componentType)) {
    return named(absl::InvalidArgumentError("has a malformed sparse part"));
  }
  out.sparse_count_ = static_cast<uint64_t>(sparse.count);
  out.sparse_index_type_ = sparse.indices.componentType;
  absl::StatusOr<Run> indices =
      OpenRun(model, sparse.indices.bufferView, sparse.indices.byteOffset, out.sparse_count_,
              ComponentSize(sparse.indices.componentType), /*may_stride=*/false);
  if (!indices.ok()) return named(indices.status());
  absl::StatusOr<Run> values = OpenRun(model, sparse.values.bufferView, sparse.values.byteOffset,
                                       out.sparse_count_, element_size, /*may_stride=*/false);
  if (!values.ok()) return named(values.status());
  out.sparse_indices_ = *indices;
  out.sparse_values_ = *values;
  // Strictly increasing, as the specification says: Element() looks them up by halves.
  uint64_t next = 0;
  for (uint64_t i = 0; i < out.sparse_count_; ++i) {
    const uint64_t index = LoadIndex(out.sparse_index_type_,
                                     out.sparse_indices_.data + i * out.sparse_indices_.stride);
    if (index < next || index >= in.count) {
      return named(absl::InvalidArgumentError(
          "has sparse indices that do not increase or reach past its end"));
    }
    next = index + 1;
  }
  return out;
}

absl::Status GltfAccessor::CheckIndices() const {
  if (components_ == 1 && IsIndexType(component_type_)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "accessor ", number_, " is used for indices, but is no list of unsigned integers"));
}

absl::Status GltfAccessor::CheckPositions() const {
  if (components_ == 3 && component_type_ != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("accessor ", number_,
                   " is used for positions, but is no VEC3 of floats or of "
                   "integers of 8 or 16 bits"));
}

const uint8_t* GltfAccessor::Element(uint64_t i) const {
  uint64_t low = 0, high = sparse_count_;  // The first replacement at or after i.
  while (low < high) {
    const uint64_t middle = low + (high - low) / 2;
    const uint64_t index =
        LoadIndex(sparse_index_type_, sparse_indices_.data + middle * sparse_indices_.stride);
    if (index == i) return sparse_values_.data + middle * sparse_values_.stride;
    if (index < i) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return base_.data == nullptr ? nullptr : base_.data + i * base_.stride;
}

uint64_t GltfAccessor::Index(uint64_t i) const {
  const uint8_t* at = Element(i);
  return at == nullptr ? 0 : LoadIndex(component_type_, at);
}

double GltfAccessor::Component(const uint8_t* at) const {
  const auto scaled = [this](double c, double one) {
    return normalized_ ? std::max(c / one, -1.0) : c;
  };
  switch (component_type_) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return scaled(Load<int8_t>(at), 127);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return scaled(Load<uint8_t>(at), 255);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return scaled(Load<int16_t>(at), 32767);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return scaled(Load<uint16_t>(at), 65535);
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return Load<float>(at);
    default:
      return Load<double>(at);
  }
}

Vec3d GltfAccessor::Position(uint64_t i) const {
  const uint8_t* at = Element(i);
  if (at == nullptr) return {};
  const size_t size = ComponentSize(component_type_);
  return {Component(at), Component(at + size), Component(at + 2 * size)};
}

}  // namespace sightline
