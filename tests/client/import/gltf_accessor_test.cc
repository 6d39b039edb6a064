// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_accessor.h"

#include "client/import/tinygltf_api.h"
#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

// An accessor of zeros, of which there may be as many as the buffers have bytes. That sum is told,
// never taken anew: a file may have half a million such accessors, and as many buffers.
TEST(GltfAccessorTest, HoldsAccessorsOfZerosAgainstTheBytesThatItIsTold) {
  sightline_tinygltf::Model model;
  model.buffers.resize(3);
  for (sightline_tinygltf::Buffer& buffer : model.buffers) buffer.data.resize(2);
  model.bufferViews.resize(1);
  model.bufferViews[0].buffer = 1;
  model.bufferViews[0].byteLength = 2;
  model.accessors.resize(1);
  sightline_tinygltf::Accessor& accessor = model.accessors[0];
  accessor.componentType = TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE;
  accessor.type = TINYGLTF_TYPE_SCALAR;
  accessor.count = 6;
  accessor.sparse.isSparse = true;
  accessor.sparse.count = 0;
  accessor.sparse.indices.bufferView = accessor.sparse.values.bufferView = 0;
  accessor.sparse.indices.byteOffset = accessor.sparse.values.byteOffset = 0;
  accessor.sparse.indices.componentType = TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE;
  EXPECT_EQ(BufferBytes(model), 6u);
  const absl::StatusOr<GltfAccessor> zeros = GltfAccessor::Open(model, 0, 6);
  ASSERT_TRUE(zeros.ok()) << zeros.status();
  EXPECT_EQ(zeros->Index(5), 0u);
  EXPECT_IMPORT_ERROR(GltfAccessor::Open(model, 0, 5).status(), kInvalidArgument,
                      "no bufferView for its 6 elements");
}

}  // namespace
}  // namespace sightline
