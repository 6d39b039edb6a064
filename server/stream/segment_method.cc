// SPDX-License-Identifier: Apache-2.0
#include "server/stream/segment_method.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "core/base/status_macros.h"
#include "core/query/segments.h"
#include "server/base/error.h"
#include "server/codec/result_codec.h"

namespace sightline {
namespace {

constexpr size_t kSegmentBytes = sizeof(std::array<Vec3d, 2>);
// So many are decoded, prepared and traced before the next: what is made of them, some 100 bytes
// each, stays in a core's own cache. Whole bytes of bits.
constexpr uint64_t kBlock = 4096;

template <typename T>
void Append(const std::vector<T>& some, std::vector<T>* all) {
  all->insert(all->end(), some.begin(), some.end());
}

}  // namespace

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
    std::vector<std::array<Vec3d, 2>> ends;
    PreparedSegments segments;
    SegmentResult result, all;
    std::vector<uint8_t> valid;
    for (uint64_t done = 0; done < range.count; done += kBlock) {
      const uint64_t count = std::min(kBlock, range.count - done);
      ends.resize(count);
      bytes_.Copy((range.offset + done) * kSegmentBytes, count * kSegmentBytes, ends.data());
      SL_RETURN_IF_ERROR(PrepareSegments(scene(), ends, {}, {}, &segments));
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
  SL_RETURN_IF_ERROR(method->OpenScene(header.stream()));
  return method;
}

std::span<const WirePath> SegmentMethod::ArrayPaths() {
  static constexpr std::array<WirePath, 1> kPaths = {
      {{Request::kItemFieldNumber, v1::SegmentItem::kSegmentsFieldNumber}}};
  return kPaths;
}

absl::Status SegmentMethod::Read(grpc::ByteBuffer* bytes, Request* request, Item* item) {
  std::array<WireArray, 1> arrays;
  SL_RETURN_IF_ERROR(ReadRequest(bytes, ArrayPaths(), request, arrays));
  if (!request->has_item()) return absl::OkStatus();
  item->message = std::move(*request->mutable_item());
  item->segments = ArrayOf(std::move(arrays[0]), item->message.mutable_segments());
  return absl::OkStatus();
}

uint64_t SegmentMethod::Rays(const Item& item) const {
  return item.segments.size() / kSegmentBytes;
}

absl::StatusOr<std::unique_ptr<ItemWork>> SegmentMethod::Prepare(Item&& item, const CancelToken&,
                                                                 uint64_t part_rays) const {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin_->ForItem());
  SL_RETURN_IF_ERROR(CheckSegments(item.segments.size()));
  SL_ASSIGN_OR_RETURN(std::vector<PartRange> parts,
                      CutIntoParts(Rays(item), 1, 1, part_rays, env_.limits,
                                   [&](uint64_t n) { return SegmentBytes(outputs_, n); }));
  return std::unique_ptr<ItemWork>(
      new SegmentWork(*this, std::move(scene), std::move(item.segments), std::move(parts)));
}

}  // namespace sightline
