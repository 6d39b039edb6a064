// SPDX-License-Identifier: Apache-2.0
//
// tinygltf's header, always with the same macros: they decide the layout and the inline code of its
// classes, so every source must see the same ones. Its image code is left out, for nothing here
// loads an image.
//
// Include this, never <tiny_gltf.h> itself.
#ifndef SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_
#define SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
// tinygltf.h uses the JSON library without including it.
// clang-format off
#include <nlohmann/json.hpp>
#include <tiny_gltf.h>
// clang-format on

#endif  // SIGHTLINE_CLIENT_IMPORT_TINYGLTF_API_H_
