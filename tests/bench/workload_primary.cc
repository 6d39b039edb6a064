// SPDX-License-Identifier: Apache-2.0
//
// primary: what is seen through every pixel; distance, triangle and barycentric weights. A unit is
// a view.
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/intersect/hit.h"
#include "core/mesh/rebase.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

// A picture's results, kept, as the peer's are: past the caches on both sides.
constexpr TileOutputs kOutputs = {
    .hits = false, .ids = true, .depth = true, .uv = true, .past_caches = true};

class PrimaryWorkload : public Workload {
 public:
  PrimaryWorkload(const WorkloadSpec& spec, const IndexedGeometry& scene, ThreadPool& pool,
                  std::vector<Camera> cameras)
      : Workload(spec.options),
        scene_(scene),
        pool_(pool),
        cameras_(std::move(cameras)),
        tiles_(CutImage(spec.width, spec.height)),
        ours_(tiles_.size()) {
    theirs_.Resize(size_t{spec.width} * spec.height);
  }

  size_t units() const override { return cameras_.size(); }
  uint64_t queries(size_t unit) const override {
    return uint64_t{cameras_[unit].width} * cameras_[unit].height;
  }
  size_t views() const override { return cameras_.size(); }
  size_t view(size_t unit) const override { return unit; }
  std::vector<PeerMode> peer_modes() const override {
    constexpr PeerMode::Start kStarts[] = {PeerMode::Start::kEye};
    return AllModes(kStarts);
  }

  void RunOurs(size_t unit) override {
    pool_.ParallelFor(tiles_.size(), 1, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const absl::Status status =
            TraceTile(scene_, cameras_[unit], tiles_[i], {}, kOutputs, options(), &ours_[i]);
        SIGHTLINE_CHECK(status.ok()) << status;
      }
    });
  }

  void RunPeer(const EmbreeScene& peer, PeerMode mode, size_t unit, Share share) override {
    const size_t step = share == Share::kAll ? 1 : kSampleStep;
    const CameraRays rays(cameras_[unit], scene_.geometry.origin);
    pool_.ParallelFor((tiles_.size() + step - 1) / step, 1, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        TraceCameraTile(peer, mode, rays, tiles_[i * step], cameras_[unit].width,
                        TileWrites::kPastCaches, &theirs_);
      }
    });
  }

  void Compare(size_t unit, Agreement* agreement) override {
    for (size_t t = 0; t < tiles_.size(); ++t) {
      const TileRect& tile = tiles_[t];
      for (uint32_t i = 0; i < tile.width * tile.height; ++i) {
        ComparePixel(unit, tile, t, i, agreement);
      }
      if (agreement->settle && t % kSampleStep == 0) CheckTile(unit, t, agreement);
    }
    agreement->queries += queries(unit);
  }

  QueryStats OurStats() const override {
    QueryStats stats;
    for (const TileResult& tile : ours_) stats.Add(tile.primary);
    return stats;
  }

  uint64_t OurDigest() const override {
    uint64_t digest = 0;
    for (const TileResult& tile : ours_) {
      digest = AddToDigest(AddToDigest(digest, tile.triangle), tile.depth);
      digest = AddToDigest(AddToDigest(digest, tile.u), tile.v);
    }
    return digest;
  }

 private:
  void ComparePixel(size_t unit, const TileRect& tile, size_t t, uint32_t i,
                    Agreement* agreement) const {
    const uint32_t x = tile.x + i % tile.width, y = tile.y + i / tile.width;
    const uint32_t theirs = theirs_.triangle[size_t{y} * cameras_[unit].width + x];
    const uint32_t ours = ours_[t].triangle[i];
    if (ours == theirs) return;
    // A tie goes to the lowest triangle: that one must be ours, else ours is wrong.
    if (ours < theirs && theirs != kNoTriangle) {
      Vec3f eye;
      SIGHTLINE_CHECK(Rebase(cameras_[unit].eye, scene_.geometry.origin, &eye));
      const PredicateRay ray = PredicateRay::Ray(eye, PixelDirection(cameras_[unit], x, y));
      const auto [a, b, c] = scene_.geometry.Corners(theirs);
      if (Blocks(ray, a, b, c) && HitDistance(ray, a, b, c) == ours_[t].depth[i]) {
        ++agreement->ties;
        return;
      }
    }
    ++agreement->disagreements;
    if (!agreement->settle) return;
    CheckPixel(unit, x, y, ours, ours_[t].depth[i], Strategy::kSingle, agreement);
    ++agreement->by_single;
    if (!agreement->CanAffordBruteForce(scene_)) return;
    CheckPixel(unit, x, y, ours, ours_[t].depth[i], Strategy::kBruteForce, agreement);
    ++agreement->by_brute_force;
  }

  void CheckPixel(size_t unit, uint32_t x, uint32_t y, uint32_t triangle, float depth,
                  Strategy strategy, Agreement* agreement) const {
    TileResult truth;
    QueryOptions asked = options();
    asked.strategy = strategy;
    const absl::Status status =
        TraceTile(scene_, cameras_[unit], {x, y, 1, 1}, {}, kOutputs, asked, &truth);
    SIGHTLINE_CHECK(status.ok()) << status;
    if (truth.triangle[0] == triangle && truth.depth[0] == depth) return;
    agreement->AddBeyondRounding(absl::StrCat(
        "view ", unit, ", pixel ", x, ",", y, ": triangle ", triangle, " at depth ", depth,
        ", but ", StrategyName(strategy), " says ", truth.triangle[0], " at ", truth.depth[0]));
  }

  // A whole tile against the single-ray walk, whatever the peer says of it.
  void CheckTile(size_t unit, size_t t, Agreement* agreement) const {
    TileResult truth;
    QueryOptions asked = options();
    asked.strategy = Strategy::kSingle;
    const absl::Status status =
        TraceTile(scene_, cameras_[unit], tiles_[t], {}, kOutputs, asked, &truth);
    SIGHTLINE_CHECK(status.ok()) << status;
    const TileResult& ours = ours_[t];
    agreement->by_single += truth.triangle.size();
    for (size_t i = 0; i < truth.triangle.size(); ++i) {
      if (truth.triangle[i] == ours.triangle[i] && truth.depth[i] == ours.depth[i] &&
          truth.u[i] == ours.u[i] && truth.v[i] == ours.v[i]) {
        continue;
      }
      agreement->AddBeyondRounding(absl::StrCat("view ", unit, ", tile ", t, ", pixel ", i,
                                                ": triangle ", ours.triangle[i],
                                                ", but SINGLE says ", truth.triangle[i]));
    }
  }

  const IndexedGeometry& scene_;
  ThreadPool& pool_;
  const std::vector<Camera> cameras_;
  const std::vector<TileRect> tiles_;
  std::vector<TileResult> ours_;  // One per tile.
  ImageArrays theirs_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<Workload>> MakePrimaryWorkload(const WorkloadSpec& spec,
                                                              const SceneSource& source,
                                                              const IndexedGeometry& scene,
                                                              ThreadPool& pool) {
  std::vector<Camera> cameras;
  for (const BuiltinView& view : source.views) {
    SL_ASSIGN_OR_RETURN(Camera camera, ViewCamera(spec, view));
    cameras.push_back(camera);
  }
  return std::make_unique<PrimaryWorkload>(spec, scene, pool, std::move(cameras));
}

}  // namespace sightline::bench
