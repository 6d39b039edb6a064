// SPDX-License-Identifier: Apache-2.0
//
// tinygltf itself, built from its header.
#define TINYGLTF_IMPLEMENTATION
#include "client/import/tinygltf_api.h"
