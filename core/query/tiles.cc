// SPDX-License-Identifier: Apache-2.0
#include "core/query/tiles.h"

#include <algorithm>
#include <array>
#include <bitset>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "absl/base/attributes.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/intersect/hit.h"
#include "core/query/hit_placement.h"
#include "core/query/mirrored_rays.h"
#include "core/query/pixel_blocks.h"
#include "core/query/pixel_runs.h"
#include "core/query/ray_block.h"
#include "core/query/sample_tracer.h"
#include "core/traverse/pixel_grid.h"
#include "core/traverse/rtt.h"
#include "hwy/cache_control.h"

namespace sightline {
namespace {

// A block is a square of pixels whose rays walk together; its lanes run through smaller squares, so
// that the lanes of one SIMD vector are neighbours in both directions. Their rows are runs of
// pixels. A group is a square of blocks that begin their walks together.
constexpr uint32_t kBlockSide = PixelBlockKernels::kSide;
constexpr uint32_t kRunPixels = PixelBlockKernels::kRun;
constexpr uint32_t kGroupSide = 4;
static_assert(kGroupSide * kBlockSide == PixelGrid::kMostSide &&
              kBlockSide == PixelGrid::kPacketSide);
static_assert(kRunPixels == PixelGrid::kRun);
static_assert(PixelBlockKernels::LaneOf(kBlockSide - 1, 0) == PixelGrid::kCornerLanes[1] &&
              PixelBlockKernels::LaneOf(0, kBlockSide - 1) == PixelGrid::kCornerLanes[2] &&
              PixelBlockKernels::LaneOf(kBlockSide - 1, kBlockSide - 1) ==
                  PixelGrid::kCornerLanes[3]);
static_assert(kBlockSide * kBlockSide == kBlockRays && kGroupSide * kGroupSide == kGroupBlocks);

class TileTrace {
 public:
  TileTrace(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile, Vec3f eye,
            std::span<const LightSample> samples, const PreparedMirrors& mirrors,
            const TileOutputs& outputs, const QueryOptions& options, TileResult* out)
      : scene_(scene),
        camera_(camera),
        tile_(tile),
        samples_(samples),
        mirrors_(mirrors),
        outputs_(outputs),
        run_(scene, options),
        blocks_(PixelBlockKernelsFor(options.simd)),
        pixels_(size_t{tile.width} * tile.height),
        row_bytes_((pixels_ + 7) / 8),
        past_caches_(outputs.past_caches && tile.width % kBlockSide == 0),
        out_(*out),
        choice_(OtherWalks(run_, RayForm::kOneOrigin, HitKind::kClosest)),
        tracer_(scene, run_, HitKind::kAny, /*t_min=*/0, samples, &out->shadow) {
    const auto prepare = [&](RayPacket& packet) {
      packet.origin = eye;
      packet.segments = false;
      packet.mask = options.mask;
      packet.want_barycentrics = outputs.uv;
    };
    if (LargeTile()) parts_.resize(kMostParts);
    prepare(block_);
    prepare(outline_);
    for (RayPacket& part : parts_) prepare(part);
    const size_t parts = std::max<size_t>(1, parts_.size());
    if (outputs.lit || outputs.points) {
      // As many blocks as the tile fills, at most a group.
      const auto blocks = [](uint32_t side) { return (side + kBlockSide - 1) / kBlockSide; };
      const size_t most = size_t{std::min(blocks(tile.width), kGroupSide)} *
                          std::min(blocks(tile.height), kGroupSide);
      tile_ends_.reserve(most * (kBlockRays / RttTileRays(1)));
      positions_.resize(most * kBlockRays);
      sources_.resize(most * kBlockRays);
      point_pixel_.resize(most * kBlockRays);
      placer_ = std::make_unique<HitPlacer>(scene, options.simd, options.cancel);
      placed_.resize(parts);
      near_surface_.resize(parts);
    }
    // Every pixel's ids and numbers are written by its block: what a result of the same size held
    // before does not matter.
    if (outputs.hits) out_.hit_bits.assign(row_bytes_, 0);
    if (outputs.ids) out_.triangle.ResizeUninitialized(pixels_);
    if (outputs.depth) out_.depth.ResizeUninitialized(pixels_);
    if (outputs.uv) {
      out_.u.ResizeUninitialized(pixels_);
      out_.v.ResizeUninitialized(pixels_);
    }
    if (outputs.mirrors) out_.mirror_bits.assign(row_bytes_, 0);
    if (!mirrors.empty()) {
      mirrored_ = std::make_unique<MirroredRays>(parts, block_,
                                                 outputs.answered_by || options.count_answers);
    }
    if (outputs.lit) out_.lit_bits.assign(samples.size() * row_bytes_, 0);
    if (outputs.answered_by) out_.answered_by.resize(pixels_);
    if (outputs.answered_by || options.count_answers) {
      block_.answered_by = answered_by_;
      parts_answered_by_.resize(parts_.size());
      for (size_t i = 0; i < parts_.size(); ++i)
        parts_[i].answered_by = parts_answered_by_[i].data();
    }
    if (outputs.lit && outputs.lit_answered_by) {
      out_.lit_answered_by.assign(samples.size() * pixels_, AnsweredBy::kNoRay);
      tracer_.RecordAnsweredBy();
    }
  }

  absl::Status Run() {
    // Groups of whole tiles: those of a tile that a group's border cut would have few rays each.
    constexpr uint32_t kMostSide = kGroupSide * kBlockSide;
    const uint32_t side = ByTiles() ? kMostSide / TileSide() * TileSide() : kMostSide;
    for (uint32_t y = 0; y < tile_.height; y += side) {
      for (uint32_t x = 0; x < tile_.width; x += side) {
        SL_RETURN_IF_ERROR(
            TraceGroup({x, y, std::min(side, tile_.width - x), std::min(side, tile_.height - y)}));
      }
    }
    if (outputs_.points) out_.SortPoints(pixels_);
    return absl::OkStatus();
  }

 private:
  // The blocks of a group, from a common cut. `group` is in pixels of the tile.
  absl::Status TraceGroup(const TileRect& group) {
    SL_RETURN_IF_ERROR(run_.Poll());
    for (uint32_t x = 0; x < group.width; ++x) {
      const Vec3d column = PixelColumn(camera_, tile_.x + group.x + x);
      for (int axis = 0; axis < 3; ++axis) columns_[axis][x] = column[axis];
    }
    for (uint32_t y = 0; y < group.height; ++y) {
      const Vec3d row = PixelRow(camera_, tile_.y + group.y + y);
      for (int axis = 0; axis < 3; ++axis) rows_[axis][y] = row[axis];
    }
    // Which pixels are hit is answered by any hit; all else needs the first.
    const bool need_first = outputs_.ids || outputs_.depth || outputs_.uv || outputs_.lit ||
                            outputs_.points || !mirrors_.empty();
    const HitKind kind = need_first ? HitKind::kClosest : HitKind::kAny;
    const Strategy strategy =
        ChooseStrategy(run_, RayForm::kOneOrigin, kind, size_t{group.width} * group.height);
    const bool one_block = group.width <= kBlockSide && group.height <= kBlockSide;
    size_t points = 0;
    tile_ends_.clear();
    {
      StatsScope scope(&out_.primary, strategy, size_t{group.width} * group.height);
      const ShaftCut* cut = strategy == Strategy::kShaft && !one_block && !choice_.ShaftsAreRare()
                                ? CutOutline(group)
                                : nullptr;
      has_grid_ = kind == HitKind::kClosest && strategy == Strategy::kShaft &&
                  MakePixelGrid(Terms(columns_), group.width, Terms(rows_), group.height, &grid_);
      const uint32_t side = strategy == Strategy::kRtt ? RttBlockSide(group)
                            : strategy == Strategy::kPacket
                                ? static_cast<uint32_t>(run_.options().packet_side)
                                : kBlockSide;
      for (uint32_t y = 0; y < group.height; y += side) {
        for (uint32_t x = 0; x < group.width; x += side) {
          const TileRect block = {x, y, std::min(side, group.width - x),
                                  std::min(side, group.height - y)};
          if (strategy == Strategy::kRtt && LargeTile()) {
            SL_RETURN_IF_ERROR(TraceLarge(group, block, kind, &scope, &points));
            continue;
          }
          Place(block);
          constexpr float kAlike = 1;  // A camera's blocks are squares of pixels, as broad as any.
          const Strategy walk = strategy == Strategy::kShaft ? choice_.Next(kAlike) : strategy;
          const WalkStats before = *scope.walk();
          SL_RETURN_IF_ERROR(
              TracePacketBlock(scene_, run_, kind, walk, packet_, cut, scope.walk()));
          scope.Took(walk);
          if (strategy == Strategy::kShaft) {
            choice_.Learn(walk, before, *scope.walk(), static_cast<size_t>(packet_->count), kAlike);
          }
          SL_RETURN_IF_ERROR(Finish(group, {&block, 1}, &scope, &points));
        }
      }
    }
    return outputs_.lit || outputs_.points ? ShadeGroup(points) : absl::OkStatus();
  }

  // What follows the walk of a block, or of a large tile's blocks: *points counts the group's
  // points.
  absl::Status Finish(const TileRect& group, std::span<const TileRect> blocks, StatsScope* scope,
                      size_t* points) {
    for (size_t i = 0; i < blocks.size(); ++i) {
      Take(i);
      if (run_.options().count_answers) {
        ForEachRun(blocks[i], Squares(), [&](const PixelRun& run) {
          CountAnswers({packet_->answered_by + run.lane, run.count}, &out_.primary);
        });
      }
      if (outputs_.lit || outputs_.points) SL_RETURN_IF_ERROR(PlaceHits());
    }
    if (!mirrors_.empty()) SL_RETURN_IF_ERROR(LookIntoMirrors(blocks, scope));
    for (size_t i = 0; i < blocks.size(); ++i) {
      Take(i);
      Write(group, blocks[i]);
      if (outputs_.lit || outputs_.points) *points = PlacePoints(group, blocks[i], *points);
    }
    return absl::OkStatus();
  }

  // From now on packet_ is that of a large tile's block `part`, or of the only one there is.
  void Take(size_t part) {
    part_ = part;
    packet_ = LargeTile() ? &parts_[part] : &block_;
  }

  // Whether relevant triangles tracing goes by tiles: AUTO never chooses it.
  bool ByTiles() const { return run_.options().strategy == Strategy::kRtt; }

  // The pixels along a tile's side.
  uint32_t TileSide() const { return RttTileSide(run_.options().rtt_antialiasing); }

  // Whether it has tiles that no packet holds.
  bool LargeTile() const { return ByTiles() && TileSide() > kBlockSide; }

  // Its tile, a block's walk and what follows it: as blocks of some of its rows, together.
  absl::Status TraceLarge(const TileRect& group, const TileRect& tile, HitKind kind,
                          StatsScope* scope, size_t* points) {
    TileRect blocks[kMostParts];
    uint32_t count = 0;
    const uint32_t rows = kBlockRays / WholeSquares(tile.width) / kRunPixels * kRunPixels;
    for (uint32_t y = 0; y < tile.height; y += rows) {
      Take(count);
      blocks[count] = {tile.x, tile.y + y, tile.width, std::min(rows, tile.height - y)};
      Place(blocks[count++]);
    }
    absl::Status status =
        TraceRttTile(scene_, run_, kind, {parts_.data(), size_t{count}}, scope->walk());
    if (status.ok()) {
      scope->Took(Strategy::kRtt);
      status = Finish(group, {blocks, count}, scope, points);
    }
    EndTile(*points);
    return status;
  }

  // Of a block of tiles: one tile, where tiles do not divide a block (three by three rays a pixel,
  // and more than four by four; these are several blocks, TraceLarge), or the group into blocks.
  uint32_t RttBlockSide(const TileRect& group) const {
    const uint32_t side = TileSide();
    const bool whole = group.width % kBlockSide == 0 && group.height % kBlockSide == 0;
    return kBlockSide % side == 0 && (whole || side == kRunPixels) ? kBlockSide : side;
  }

  // All rays of the group lie between those of its corners.
  const ShaftCut* CutOutline(const TileRect& group) {
    // Around it: lanes 0 and 3 are in one row, which the shaft's frame follows.
    int lane = 0;
    for (const auto& [x, y] :
         {std::pair(0u, 0u), std::pair(0u, group.height - 1),
          std::pair(group.width - 1, group.height - 1), std::pair(group.width - 1, 0u)}) {
      outline_.target_x[lane] = static_cast<float>(columns_[0][x] + rows_[0][y]);
      outline_.target_y[lane] = static_cast<float>(columns_[1][x] + rows_[1][y]);
      outline_.target_z[lane] = static_cast<float>(columns_[2][x] + rows_[2][y]);
      ++lane;
    }
    outline_.count = lane;
    return CutGroup(scene_, run_, std::span<const RayPacket>(&outline_, 1), &cut_);
  }

  // Where tiles are of lanes that follow one another, squares have the lanes of whole ones.
  SquareLanes Squares() const { return ByTiles() ? SquareLanes::kWhole : SquareLanes::kOfPixels; }

  // The block's rays. `block` is in pixels of its group.
  void Place(const TileRect& block) {
    const bool whole = IsWhole(block), fill = ByTiles() && !whole;
    packet_->count = static_cast<int>(fill ? WholeSquares(block.width) * WholeSquares(block.height)
                                           : block.width * block.height);
    packet_->grid = has_grid_ && whole ? &grid_ : nullptr;
    packet_->grid_column = block.x;
    packet_->grid_row = block.y;
    float* const targets[3] = {packet_->target_x, packet_->target_y, packet_->target_z};
    for (int axis = 0; axis < 3; ++axis) {
      const double* columns = columns_[axis] + block.x;
      const double* rows = rows_[axis] + block.y;
      float* target = targets[axis];
      if (whole) {
        blocks_.lay_out(columns, rows, target);
        continue;
      }
      ForEachRun(block, Squares(), [&](const PixelRun& run) {
        for (uint32_t k = 0; k < run.count; ++k) {
          target[run.lane + k] = static_cast<float>(columns[run.x + k] + rows[run.y]);
        }
        if (!fill) return;
        // The paper renders a larger picture, and crops it: here a cut square's last rays are its
        // other rays' again.
        float* const last = target + run.lane;
        std::fill(last + run.count, last + kRunPixels, last[run.count - 1]);
        if (run.y + 1 < block.height) return;
        for (uint32_t y = block.height; y % kRunPixels != 0; ++y) {
          std::copy_n(last, kRunPixels, last + (y + 1 - block.height) * kRunPixels);
        }
      });
    }
  }

  using GroupTerms = double[3][kGroupSide * kBlockSide];
  static PixelTerms Terms(const GroupTerms& terms) { return {terms[0], terms[1], terms[2]}; }

  static bool IsWhole(const TileRect& block) {
    return block.width == kBlockSide && block.height == kBlockSide;
  }

  // The first pixel of the block, in the tile.
  size_t FirstPixel(const TileRect& group, const TileRect& block) const {
    return size_t{group.y + block.y} * tile_.width + group.x + block.x;
  }

  void Write(const TileRect& group, const TileRect& block) {
    const size_t first = FirstPixel(group, block);
    const auto copy = [&](const auto& whole, const auto* from, auto* to) {
      to += first;
      if (IsWhole(block)) {
        whole(from, to, tile_.width);
        return;
      }
      ForEachRun(block, Squares(), [&](const PixelRun& run) {
        std::copy_n(from + run.lane, run.count, to + size_t{run.y} * tile_.width + run.x);
      });
    };
    const auto write = past_caches_ ? blocks_.stream : blocks_.write;
    if (outputs_.ids) {
      copy(past_caches_ ? blocks_.stream_ids : blocks_.write_ids, packet_->triangle,
           out_.triangle.data());
    }
    if (outputs_.depth) copy(write, packet_->t, out_.depth.data());
    if (outputs_.uv) {
      copy(write, packet_->u, out_.u.data());
      copy(write, packet_->v, out_.v.data());
    }
    if (outputs_.answered_by) {
      ForEachRun(block, Squares(), [&](const PixelRun& run) {
        std::copy_n(packet_->answered_by + run.lane, run.count,
                    out_.answered_by.data() + first + size_t{run.y} * tile_.width + run.x);
      });
    }
    if (outputs_.mirrors && !mirrors_.empty()) {
      ForEachRun(block, Squares(), [&](const PixelRun& run) {
        const size_t pixel = first + size_t{run.y} * tile_.width + run.x;
        for (uint32_t k = 0; k < run.count; ++k) {
          if (mirrored_->mirror_of(part_)[run.lane + k] == 0) continue;
          SetBit(out_.mirror_bits.data(), pixel + k);
        }
      });
    }
    if (!outputs_.hits) return;
    ForEachRun(block, Squares(), [&](const PixelRun& run) {
      const size_t pixel = first + size_t{run.y} * tile_.width + run.x;
      for (uint32_t k = 0; k < run.count; ++k) {
        if (packet_->triangle[run.lane + k] != kNoTriangle) SetBit(out_.hit_bits.data(), pixel + k);
      }
    });
  }

  // The block's hits, whatever they are on.
  absl::Status PlaceHits() {
    // Placing belongs to the shadows' cost, though it asks about no ray.
    const StatsScope scope(&out_.shadow, run_.options().strategy, /*rays=*/0);
    if (!placer_->Place(*packet_, placed_[part_])) return run_.Stopped();
    near_surface_[part_] = placer_->near_surface();
    return absl::OkStatus();
  }

  // Replaces hits on mirrors by what is seen in them.
  absl::Status LookIntoMirrors(std::span<const TileRect> blocks, StatsScope* scope) {
    const std::span<const PreparedMirror> all = mirrors_.all();
    const std::span<const RayPacket> packets(LargeTile() ? parts_.data() : &block_, blocks.size());
    for (size_t i = 0; i < blocks.size(); ++i) {
      mirrored_->Meet(all, blocks[i], Squares(), packets[i], i);
    }
    // What a mirror shows is tiles, too.
    const int tile_rays = ByTiles() ? RttTileRays(run_.options().rtt_antialiasing) : 0;
    for (size_t m = 0; m < all.size(); ++m) {
      const auto number = static_cast<uint8_t>(m + 1);
      const size_t rays = mirrored_->LayOut(all[m], number, packets, tile_rays);
      if (rays == 0) continue;
      scope->AddRays(rays);
      const Strategy strategy = ChooseStrategy(run_, RayForm::kMirrored, HitKind::kClosest, rays);
      const std::span<RayPacket> seen = mirrored_->packets();
      SL_RETURN_IF_ERROR(LargeTile()
                             ? TraceRttTile(scene_, run_, HitKind::kClosest, seen, scope->walk())
                             : TracePacketBlock(scene_, run_, HitKind::kClosest, strategy,
                                                seen.data(), nullptr, scope->walk()));
      for (size_t i = 0; i < seen.size(); ++i) SL_RETURN_IF_ERROR(ShowMirrored(i, number));
    }
    return absl::OkStatus();
  }

  // Puts what is seen in a mirror where it was met: for a ray that stands again, what is there.
  absl::Status ShowMirrored(size_t packet, uint8_t number) {
    const RayPacket& seen = mirrored_->packets()[packet];
    const int* const lanes = mirrored_->lanes_of(packet);
    Take(mirrored_->block_of(packet));
    Vec3f placed[kBlockRays];
    if (placer_ != nullptr && !placer_->Place(seen, placed)) return run_.Stopped();
    for (int i = 0; i < seen.count; ++i) {
      const int lane = lanes[i];
      packet_->t[lane] = seen.t[i];
      packet_->triangle[lane] = seen.triangle[i];
      if (outputs_.uv) {
        packet_->u[lane] = seen.u[i];
        packet_->v[lane] = seen.v[i];
      }
      if (seen.answered_by != nullptr) packet_->answered_by[lane] = seen.answered_by[i];
      if (placer_ == nullptr) continue;
      placed_[part_][lane] = placed[i];
      near_surface_[part_][lane] = placer_->near_surface()[i];
    }
    for (int lane = 0; run_.options().count_answers && lane < packet_->count; ++lane) {
      if (mirrored_->mirror_of(part_)[lane] != number) continue;
      CountAnswers({packet_->answered_by + lane, 1}, &out_.primary);
    }
    return absl::OkStatus();
  }

  // Appends the block's hits to the group's points; returns how many there are now.
  size_t PlacePoints(const TileRect& group, const TileRect& block, size_t points) {
    const size_t first = FirstPixel(group, block), begin = points;
    size_t near_surface = 0;
    const auto add = [&](size_t lane, size_t pixel) {
      positions_[points] = placed_[part_][lane];
      sources_[points] = packet_->triangle[lane];
      point_pixel_[points++] = static_cast<uint32_t>(pixel);
    };
    const size_t none = static_cast<size_t>(packet_->count);
    size_t stand_in = PixelShadowPackets() ? 0 : none;  // The first hit, for those that have none.
    while (stand_in < none && packet_->triangle[stand_in] == kNoTriangle) ++stand_in;
    const uint32_t part = ByTiles() ? TileSide() : kBlockSide;
    for (uint32_t y = 0; y < block.height; y += part) {
      for (uint32_t x = 0; x < block.width; x += part) {
        const TileRect tile = {x, y, std::min(part, block.width - x),
                               std::min(part, block.height - y)};
        ForEachRunOf(tile, block, Squares(), [&](const PixelRun& run) {
          for (uint32_t k = 0; k < run.count; ++k) {
            const size_t lane = static_cast<size_t>(run.lane) + k;
            if (packet_->triangle[lane] != kNoTriangle) {
              add(lane, first + size_t{run.y} * tile_.width + run.x + k);
              near_surface += near_surface_[part_][lane];
            } else if (stand_in != none) {
              add(stand_in, kNoPixel);
            }
          }
        });
        if (!LargeTile()) EndTile(points);
      }
    }
    // Packets at the tile's edge are filled up.
    const auto side = static_cast<size_t>(run_.options().packet_side);
    while (stand_in != none && points - begin < side * side) add(stand_in, kNoPixel);
    if (outputs_.points) out_.points.near_surface += near_surface;
    return points;
  }

  // A tile's hits are what its lights are asked about together, however many they are (paper 002,
  // section 3.2): there are `points` points now.
  void EndTile(size_t points) {
    if (!ByTiles() || points == (tile_ends_.empty() ? 0 : tile_ends_.back())) return;
    tile_ends_.push_back(static_cast<uint32_t>(points));
  }

  // Whether the group's points hold more than hits: some stand in, and have no pixel.
  bool PixelShadowPackets() const {
    return outputs_.lit && run_.options().pixel_shadow_packets &&
           run_.options().strategy == Strategy::kPacket;
  }

  absl::Status ShadeGroup(size_t points) {
    if (outputs_.points) {
      const auto append = [&](const auto& from, auto& to) {
        to.insert(to.end(), from.begin(), from.begin() + static_cast<ptrdiff_t>(points));
      };
      append(positions_, out_.points.positions);
      append(sources_, out_.points.sources);
      append(point_pixel_, out_.point_pixel);
    }
    if (!outputs_.lit) return absl::OkStatus();
    SL_RETURN_IF_ERROR(ShadeBy(points, /*directional=*/false));
    // A sun's packets are of hits alone.
    return ShadeBy(PixelShadowPackets() ? DropStandIns(points) : points, /*directional=*/true);
  }

  absl::Status ShadeBy(size_t points, bool directional) {
    tracer_.SetPoints({positions_.data(), points}, {sources_.data(), points}, tile_ends_);
    for (size_t s = 0; s < samples_.size(); ++s) {
      if (!samples_[s].valid || samples_[s].directional != directional) continue;
      SL_RETURN_IF_ERROR(tracer_.Trace(s));
      uint8_t* row = out_.lit_bits.data() + s * row_bytes_;
      for (size_t i = 0; i < points; ++i) {
        if (tracer_.triangle(i) != kNoTriangle || point_pixel_[i] == kNoPixel) continue;
        SetBit(row, point_pixel_[i]);
      }
      for (size_t i = 0; i < points && outputs_.lit_answered_by; ++i) {
        if (point_pixel_[i] == kNoPixel) continue;
        out_.lit_answered_by[s * pixels_ + point_pixel_[i]] = tracer_.answered_by(i);
      }
    }
    return absl::OkStatus();
  }

  size_t DropStandIns(size_t points) {
    size_t hits = 0;
    for (size_t i = 0; i < points; ++i) {
      positions_[hits] = positions_[i];
      sources_[hits] = sources_[i];
      point_pixel_[hits] = point_pixel_[i];
      hits += point_pixel_[hits] != kNoPixel;
    }
    return hits;
  }

  static void SetBit(uint8_t* row, size_t pixel) { row[pixel / 8] |= uint8_t(1u << (pixel % 8)); }

  const IndexedGeometry& scene_;
  const Camera& camera_;
  const TileRect tile_;
  const std::span<const LightSample> samples_;
  const PreparedMirrors& mirrors_;
  const TileOutputs& outputs_;
  const QueryRun run_;
  const PixelBlockKernels& blocks_;
  const size_t pixels_, row_bytes_;
  const bool past_caches_;
  TileResult& out_;
  RayPacket block_;
  RayPacket* packet_ = &block_;  // The block being traced,
  size_t part_ = 0;              // and which of a large tile's it is.
  // Those of a tile that no packet holds. Rows are whole squares: 12 of 20 pixels, 8 of 24.
  static constexpr uint32_t kMostParts = 3;
  static_assert(RttTileRays(kMaxRttAntialiasing) <= kMostParts * 192);
  std::vector<RayPacket> parts_;
  std::vector<std::array<AnsweredBy, kBlockRays>> parts_answered_by_;
  AnsweredBy answered_by_[kBlockRays];
  std::unique_ptr<MirroredRays> mirrored_;  // Where there are mirrors.
  RayPacket outline_;                       // The corners of its group.
  ShaftCut cut_;
  // PixelColumn and PixelRow of the group's columns and rows, by axis.
  GroupTerms columns_, rows_;
  PixelGrid grid_;  // Of the group, where it has_grid_.
  bool has_grid_ = false;
  std::unique_ptr<HitPlacer> placer_;                  // Large, and not always needed.
  std::vector<std::array<Vec3f, kBlockRays>> placed_;  // By block and lane, where there is one.
  std::vector<std::bitset<kBlockRays>> near_surface_;  // Likewise.
  // The group's points.
  std::vector<Vec3f> positions_;
  std::vector<uint32_t> sources_, point_pixel_;
  std::vector<uint32_t> tile_ends_;  // Where each of its tiles' end; ByTiles() alone.
  WalkChoice choice_;                // Of the camera's rays.
  SampleTracer tracer_;
};

// Not inlined: float_environment.h says why.
ABSL_ATTRIBUTE_NOINLINE
absl::Status Trace(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                   std::span<const LightSample> samples, const PreparedMirrors& mirrors,
                   const TileOutputs& outputs, const QueryOptions& options, TileResult* result) {
  SL_RETURN_IF_ERROR(ValidateCamera(camera));
  SL_RETURN_IF_ERROR(CheckRect(camera, tile));
  SL_RETURN_IF_ERROR(CheckOptions(scene, options));
  SL_ASSIGN_OR_RETURN(const Vec3f eye, EyeInScene(camera, scene.geometry.origin));
  return TileTrace(scene, camera, tile, eye, samples, mirrors, outputs, options, result).Run();
}

}  // namespace

absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, std::span<const Mirror> mirrors,
                       const TileOutputs& outputs, const QueryOptions& options,
                       TileResult* result) {
  const absl::StatusOr<PreparedMirrors> prepared =
      PrepareMirrors(scene.geometry, mirrors, camera, options.cancel);
  if (!prepared.ok()) {
    *result = TileResult();
    return prepared.status();
  }
  return TraceTile(scene, camera, tile, samples, *prepared, outputs, options, result);
}

absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, const PreparedMirrors& mirrors,
                       const TileOutputs& outputs, const QueryOptions& options,
                       TileResult* result) {
  const ScopedFloatEnvironment environment;
  result->Reset(outputs);
  absl::Status status = Trace(scene, camera, tile, samples, mirrors, outputs, options, result);
  if (outputs.past_caches) hwy::FlushStream();
  if (!status.ok()) *result = TileResult();
  return status;
}

}  // namespace sightline
