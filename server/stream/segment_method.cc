// SPDX-License-Identifier: Apache-2.0
#include "server/stream/segment_method.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/status_macros.h"
#include "core/query/segments.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/result_codec.h"

namespace sightline {
namespace {

// So many are decoded, prepared and traced before the next: what is made of them, some 100 bytes
// each, stays in a core's own cache. Whole bytes of bits.
constexpr uint64_t kBlock = 4096;

absl::Status PrepareEnds(const Scene& scene, std::span<const std::array<Vec3d, 2>> ends,
                         PreparedSegments* segments) {
  return PrepareSegments(scene, ends, {}, {}, segments);
}
absl::Status PrepareEnds(const Scene& scene, std::span<const std::array<Vec3f, 2>> ends,
                         PreparedSegments* segments) {
  return PrepareStoredSegments(scene, ends, {}, {}, segments);
}

template <typename T>
void Append(const std::vector<T>& some, std::vector<T>* all) {
  all->insert(all->end(), some.begin(), some.end());
}

std::string Text(Vec3d v) { return absl::StrFormat("(%.17g, %.17g, %.17g)", v.x, v.y, v.z); }

}  // namespace

// `End` is Vec3d for segments in the world, Vec3f for stored ones.
template <typename End>
class SegmentMethod::SegmentWork final : public ItemWork {
 public:
  SegmentWork(const SegmentMethod& method, std::shared_ptr<const Scene> scene, WireArray bytes,
              std::vector<PartRange> parts)
      : ItemWork(std::move(scene), std::move(parts)), method_(method), bytes_(std::move(bytes)) {}

  absl::StatusOr<PartRange> RunPart(size_t part, const CancelToken& cancel, ItemReply* reply,
                                    QueryStats* stats) override {
    const PartRange range = parts()[part];
    const v1::SegmentOutputs& wanted = method_.outputs_;
    const QueryOptions options = PartOptions(method_.options_.query, cancel);
    using Ends = std::array<End, 2>;
    std::vector<Ends> ends;
    PreparedSegments segments;
    SegmentResult result, all;
    std::vector<uint8_t> valid;
    for (uint64_t done = 0; done < range.count; done += kBlock) {
      const uint64_t count = std::min(kBlock, range.count - done);
      ends.resize(count);
      bytes_.Copy((range.offset + done) * sizeof(Ends), count * sizeof(Ends), ends.data());
      SL_RETURN_IF_ERROR(PrepareEnds(scene(), std::span<const Ends>(ends), &segments));
      SL_RETURN_IF_ERROR(TestSegments(
          scene(), segments,
          SegmentOutputs{.bits = wanted.blocked_bits(), .first_hits = wanted.first_blockers()},
          options, &result));
      stats->Add(result.stats);
      Append(result.blocked_bits, &all.blocked_bits);
      Append(result.triangle, &all.triangle);
      Append(result.t, &all.t);
      Append(segments.valid, &valid);
    }
    reply->Add(v1::SegmentReply::kSegmentsFieldNumber,
               EncodeSegments(scene().geometry, std::move(all), valid, wanted));
    return range;
  }

 private:
  const SegmentMethod& method_;
  const WireArray bytes_;  // As they came.
};

absl::StatusOr<std::unique_ptr<SegmentMethod>> SegmentMethod::Open(const Header& header,
                                                                   const QueryEnvironment& env) {
  std::unique_ptr<SegmentMethod> method(new SegmentMethod(env));
  SL_ASSIGN_OR_RETURN(method->options_, DecodeOptions(header.stream().options()));
  method->outputs_ = WantedSegments(header.outputs());
  if (header.has_origin()) {
    const Vec3d origin = DecodeVector(header.origin());
    if (!IsFinite(origin)) {
      return InvalidField("header.origin", Text(origin), "must be finite");
    }
    method->origin_ = origin;
  }
  SL_RETURN_IF_ERROR(method->OpenScene(header.stream()));
  return method;
}

std::span<const WirePath> SegmentMethod::ArrayPaths() {
  static constexpr std::array<WirePath, 2> kPaths = {
      {{Request::kItemFieldNumber, v1::SegmentItem::kSegmentsFieldNumber},
       {Request::kItemFieldNumber, v1::SegmentItem::kSegmentsF32FieldNumber}}};
  return kPaths;
}

absl::Status SegmentMethod::Read(grpc::ByteBuffer* bytes, const ElementLimit& elements,
                                 Request* request, Item* item) {
  std::array<WireArray, 2> arrays;
  SL_RETURN_IF_ERROR(ReadRequest(bytes, ArrayPaths(), elements, request, arrays));
  if (!request->has_item()) return absl::OkStatus();
  item->message = std::move(*request->mutable_item());
  item->segments = ArrayOf(std::move(arrays[0]), item->message.mutable_segments());
  item->stored_segments = ArrayOf(std::move(arrays[1]), item->message.mutable_segments_f32());
  return absl::OkStatus();
}

uint64_t SegmentMethod::Rays(const Item& item) const {
  return item.segments.size() / kSegmentBytes +
         item.stored_segments.size() / kStoredSegmentBytes;  // One of them is empty, or refused.
}

absl::Status SegmentMethod::CheckOrigin(const Scene& scene) const {
  if (!origin_.has_value()) {
    return InvalidField("header.origin", "(unset)", "is what item.segments_f32 is relative to");
  }
  const Vec3d current = scene.geometry.origin;
  if (*origin_ == current) return absl::OkStatus();
  return MakeError(
      absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_ORIGIN_MISMATCH,
      absl::StrCat("header.origin = ", Text(*origin_), ", but the origin of ",
                   SceneName(scene.name), " is ", Text(current), "; read it again"),
      {{"resource", SceneName(scene.name)}, {"value", Text(*origin_)}, {"current", Text(current)}});
}

absl::StatusOr<std::unique_ptr<ItemWork>> SegmentMethod::Prepare(Item&& item, const CancelToken&,
                                                                 uint64_t part_rays) const {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin_->ForItem());
  const bool stored = !item.stored_segments.empty();
  SL_RETURN_IF_ERROR(CheckSegments(item.segments.size(), item.stored_segments.size()));
  if (stored) SL_RETURN_IF_ERROR(CheckOrigin(*scene));
  SL_ASSIGN_OR_RETURN(std::vector<PartRange> parts,
                      CutIntoParts(Rays(item), 1, 1, part_rays, env_.limits,
                                   [&](uint64_t n) { return SegmentBytes(outputs_, n); }));
  if (stored) {
    return std::unique_ptr<ItemWork>(new SegmentWork<Vec3f>(
        *this, std::move(scene), std::move(item.stored_segments), std::move(parts)));
  }
  return std::unique_ptr<ItemWork>(
      new SegmentWork<Vec3d>(*this, std::move(scene), std::move(item.segments), std::move(parts)));
}

}  // namespace sightline
