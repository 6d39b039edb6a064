// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/embree_peer.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/mesh/rebase.h"

namespace sightline::bench {
namespace {

absl::Status LastError(RTCDevice device, const char* what) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return absl::OkStatus();
  const absl::StatusCode code = error == RTC_ERROR_OUT_OF_MEMORY
                                    ? absl::StatusCode::kResourceExhausted
                                    : absl::StatusCode::kInternal;
  return absl::Status(code, absl::StrCat("Embree: ", what, ": error ", static_cast<int>(error)));
}

RTCBuildQuality SceneQuality(EmbreeOptions::Quality quality) {
  switch (quality) {
    case EmbreeOptions::Quality::kMedium:
      return RTC_BUILD_QUALITY_MEDIUM;
    case EmbreeOptions::Quality::kHigh:
      return RTC_BUILD_QUALITY_HIGH;
    case EmbreeOptions::Quality::kLow:
    case EmbreeOptions::Quality::kRefit:
      break;
  }
  return RTC_BUILD_QUALITY_LOW;
}

}  // namespace

absl::StatusOr<std::unique_ptr<EmbreeDevice>> EmbreeDevice::Open(int threads, SimdTarget simd) {
  std::string config = absl::StrCat("threads=", threads);
  // Left to itself Embree may avoid 512-bit code for the clock's sake; ours does not.
  const bool wide = simd == SimdTarget::kAvx512 ||
                    (simd == SimdTarget::kBest && BestSimdTarget() == SimdTarget::kAvx512);
  absl::StrAppend(&config, wide ? ",isa=avx512,frequency_level=simd512" : ",isa=avx2");
  auto device = std::unique_ptr<EmbreeDevice>(new EmbreeDevice);
  device->device_ = rtcNewDevice(config.c_str());
  if (device->device_ == nullptr) {
    return absl::UnavailableError(absl::StrCat("Embree opens no device with \"", config,
                                               "\": error ",
                                               static_cast<int>(rtcGetDeviceError(nullptr))));
  }
  rtcSetDeviceMemoryMonitorFunction(device->device_, &EmbreeDevice::OnMemory, device.get());
  return device;
}

EmbreeDevice::~EmbreeDevice() {
  if (device_ != nullptr) rtcReleaseDevice(device_);
}

bool EmbreeDevice::OnMemory(void* self, ssize_t bytes, bool) {
  static_cast<EmbreeDevice*>(self)->allocated_ += bytes;
  return true;
}

std::string EmbreeDevice::Name() { return absl::StrCat("Embree ", RTC_VERSION_STRING); }

PeerMesh::PeerMesh(const SceneGeometry& geometry) {
  vertices_.reserve(geometry.vertices.size() + 1);
  vertices_.Append(geometry.vertices);
  vertices_.push_back({});
  triangles_.reserve(geometry.triangles.size() + 1);
  triangles_.Append(geometry.triangles);
  triangles_.push_back({});
}

PeerMesh::PeerMesh(std::span<const ObjectInput> objects, Vec3d origin, ThreadPool& pool) {
  constexpr size_t kGrain = 1 << 14;
  size_t vertices = 0, triangles = 0;
  for (const ObjectInput& object : objects) {
    vertices += object.vertices.size();
    triangles += object.indices.size() / 3;
  }
  vertices_.ResizeUninitialized(vertices + 1);
  vertices_.back() = {};
  triangles_.ResizeUninitialized(triangles + 1);
  triangles_.back() = {};
  size_t first_vertex = 0, first_triangle = 0;
  for (const ObjectInput& object : objects) {
    pool.ParallelFor(object.vertices.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        vertices_[first_vertex + i] = ToFloat(object.transform.Apply(object.vertices[i]) - origin);
      }
    });
    pool.ParallelFor(object.indices.size() / 3, kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        for (size_t k = 0; k < 3; ++k) {
          triangles_[first_triangle + i][k] =
              static_cast<uint32_t>(first_vertex) + object.indices[3 * i + k];
        }
      }
    });
    first_vertex += object.vertices.size();
    first_triangle += object.indices.size() / 3;
  }
}

size_t PeerMesh::bytes() const {
  return vertex_count() * sizeof(vertices_[0]) + triangle_count() * sizeof(triangles_[0]);
}

absl::StatusOr<std::unique_ptr<EmbreeScene>> EmbreeScene::Build(const EmbreeDevice& device,
                                                                const PeerMesh& mesh,
                                                                const EmbreeOptions& options) {
  using Quality = EmbreeOptions::Quality;
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  const bool dynamic = options.quality == Quality::kLow || options.quality == Quality::kRefit;
  auto scene = std::unique_ptr<EmbreeScene>(new EmbreeScene);
  scene->scene_ = rtcNewScene(device.get());
  int flags = RTC_SCENE_FLAG_NONE;
  if (options.robust) flags |= RTC_SCENE_FLAG_ROBUST;
  if (options.compact) flags |= RTC_SCENE_FLAG_COMPACT;
  if (dynamic) flags |= RTC_SCENE_FLAG_DYNAMIC;
  rtcSetSceneFlags(scene->scene_, static_cast<RTCSceneFlags>(flags));
  rtcSetSceneBuildQuality(scene->scene_, SceneQuality(options.quality));
  scene->geometry_ = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  RTCGeometry geometry = scene->geometry_;
  rtcSetGeometryBuildQuality(geometry, options.quality == Quality::kRefit
                                           ? RTC_BUILD_QUALITY_REFIT
                                           : SceneQuality(options.quality));
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                             mesh.vertices().data(), 0, sizeof(Vec3f), mesh.vertex_count());
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.triangles().data(), 0, 3 * sizeof(uint32_t),
                             mesh.triangle_count());
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene->scene_, geometry);
  rtcCommitScene(scene->scene_);
  if (absl::Status status = LastError(device.get(), "building the scene"); !status.ok()) {
    return status;
  }
  return scene;
}

EmbreeScene::~EmbreeScene() {
  if (geometry_ != nullptr) rtcReleaseGeometry(geometry_);
  if (scene_ != nullptr) rtcReleaseScene(scene_);
}

void EmbreeScene::CommitMovedVertices() {
  rtcUpdateGeometryBuffer(geometry_, RTC_BUFFER_TYPE_VERTEX, 0);
  rtcCommitGeometry(geometry_);
  rtcCommitScene(scene_);
}

std::string PeerMode::Name() const {
  std::string name = entry == Entry::kSingle   ? "single"
                     : entry == Entry::kStream ? "stream"
                                               : absl::StrCat("packet", static_cast<int>(entry));
  if (coherent) absl::StrAppend(&name, " coherent");
  absl::StrAppend(&name, start == Start::kEye     ? ""
                         : start == Start::kLight ? " from light"
                                                  : " from point");
  if (sorted) absl::StrAppend(&name, ", sorted");
  return name;
}

std::vector<PeerMode> AllModes(std::span<const PeerMode::Start> starts, bool sorted) {
  using Entry = PeerMode::Entry;
  std::vector<PeerMode> modes;
  for (const PeerMode::Start start : starts) {
    for (const Entry entry :
         {Entry::kSingle, Entry::kPacket4, Entry::kPacket8, Entry::kPacket16, Entry::kStream}) {
      for (const bool coherent : {false, true}) {
        modes.push_back({entry, coherent, start});
        if (sorted) modes.push_back({entry, coherent, start, /*sorted=*/true});
      }
    }
  }
  return modes;
}

void ImageArrays::Resize(size_t pixels) {
  depth.resize(pixels);
  u.resize(pixels);
  v.resize(pixels);
  triangle.resize(pixels);
}

CameraRays::CameraRays(const Camera& camera, Vec3d origin) {
  SIGHTLINE_CHECK(Rebase(camera.eye, origin, &eye_)) << "the eye is out of range";
  // The operations of PixelDirection, in its order.
  const double w = camera.width, h = camera.height;
  for (uint32_t x = 0; x < camera.width; ++x) {
    const double sx = ((2.0 * (x + 0.5)) / w - 1.0) * (camera.tan_half_fov_y * (w / h));
    const Vec3d column = camera.forward + camera.right * sx;
    for (int axis = 0; axis < 3; ++axis) column_[axis].push_back(column[axis]);
  }
  for (uint32_t y = 0; y < camera.height; ++y) {
    const double sy = (1.0 - (2.0 * (y + 0.5)) / h) * camera.tan_half_fov_y;
    const Vec3d row = camera.up * sy;
    for (int axis = 0; axis < 3; ++axis) row_[axis].push_back(row[axis]);
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (std::vector<double>* table : {&column_[axis], &row_[axis]}) {
      if (table->size() % 2 != 0) table->push_back(table->back());
    }
  }
}

}  // namespace sightline::bench
