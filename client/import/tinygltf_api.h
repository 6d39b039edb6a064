// SPDX-License-Identifier: Apache-2.0
//
// tinygltf's header, in a namespace of its own and always with the same macros.
//
// Debian's libdraco, which comes with assimp, exports a tinygltf of another version: two sets of
// classes of one name in one process, of which the loader takes whichever it meets first. Linked
// with libtinygltf.so, reading a GLB freed an invalid pointer; under a name of its own it does not.
// (That the clash was the cause is likely, not proven.) The macro below gives the header's
// namespace its other name. The image code is left out, for nothing here loads an image.
//
// Include this, never <tiny_gltf.h> itself.
//
// Thread safety: as tinygltf's: one loader per thread.
#ifndef SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_
#define SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
// The header uses the JSON library without including it.
// clang-format off
#include <nlohmann/json.hpp>
#define tinygltf sightline_tinygltf
#include <tiny_gltf.h>
#undef tinygltf
// clang-format on

#endif  // SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_
