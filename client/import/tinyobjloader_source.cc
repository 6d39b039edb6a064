// SPDX-License-Identifier: Apache-2.0
//
// tinyobjloader from its header, for the fuzzers alone: built with coverage and sanitizers, which
// Debian's shared library is not. Its coordinate type comes from the build
// (TINYOBJLOADER_USE_DOUBLE).
#define TINYOBJLOADER_IMPLEMENTATION
#include <tiny_obj_loader.h>
