# Every outside library, found once. All are Debian 12 packages; the README says why each was chosen.

include_guard(GLOBAL)

find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(absl REQUIRED)
find_package(TBB REQUIRED)
pkg_check_modules(HWY REQUIRED IMPORTED_TARGET libhwy)

if(NOT SIGHTLINE_CORE_ONLY)
  find_package(Protobuf REQUIRED)
  find_package(gRPC REQUIRED)
  find_package(spdlog REQUIRED)
  pkg_check_modules(YAML_CPP REQUIRED IMPORTED_TARGET yaml-cpp)
  pkg_check_modules(PROMETHEUS REQUIRED IMPORTED_TARGET prometheus-cpp-core)
  find_package(civetweb REQUIRED)
  find_package(assimp REQUIRED)
  find_package(PNG REQUIRED)
  find_package(ZLIB REQUIRED)
  find_package(LibLZMA REQUIRED)
  pkg_check_modules(TINYOBJ_DOUBLE REQUIRED IMPORTED_TARGET tinyobjloader_double)
  find_path(TINYGLTF_HEADER tiny_gltf.h REQUIRED)  # libtinygltf-dev; used as a header.
  find_package(nlohmann_json REQUIRED)
endif()
if(SIGHTLINE_BUILD_TESTS)
  find_package(GTest REQUIRED)
endif()
if(SIGHTLINE_BUILD_BENCH)
  if(SIGHTLINE_CORE_ONLY)
    message(FATAL_ERROR "SIGHTLINE_BUILD_BENCH reads scenes with the importers: not with SIGHTLINE_CORE_ONLY")
  endif()
  find_package(embree 3 REQUIRED)  # The peer of sightline-bench; nothing else links it.
endif()
