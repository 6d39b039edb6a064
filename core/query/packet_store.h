// SPDX-License-Identifier: Apache-2.0
//
// The packets of a tracer, in memory that its thread keeps for the next one: a call for a tile is
// over in some ten or twenty microseconds, of which a hundred kilobytes taken and given back would
// be one or two in a hundred. A thread keeps no more than the largest array that it has used.
// Internal to core/query.
//
// Thread safety: a store belongs to the thread that made it, which is to end it, too.
//
//   PacketStore<RayPacket> packets;
//   packets.Reserve(16);
//   packets[15].count = 0;
#ifndef SIGHTLINE_CORE_QUERY_PACKET_STORE_H_
#define SIGHTLINE_CORE_QUERY_PACKET_STORE_H_

#include <cstddef>
#include <memory>
#include <type_traits>
#include <utility>

namespace sightline {

template <typename Packet>
class PacketStore {
  static_assert(std::is_trivially_destructible_v<Packet>, "made anew without an end");

 public:
  PacketStore() = default;
  PacketStore(const PacketStore&) = delete;
  PacketStore& operator=(const PacketStore&) = delete;
  ~PacketStore() {
    if (Array& kept = OfThread(); kept.size < array_.size) std::swap(kept, array_);
  }

  // Has room for at least `count` packets. If there was less they are new: rows are not
  // initialized, all else is as their kind has it.
  void Reserve(size_t count) {
    if (array_.size >= count) return;
    if (Array& kept = OfThread(); kept.size >= count) {
      array_ = std::exchange(kept, {});
      std::uninitialized_default_construct_n(array_.packets.get(), array_.size);
    } else {
      array_ = {std::make_unique_for_overwrite<Packet[]>(count), count};
    }
  }

  Packet* get() const { return array_.packets.get(); }
  Packet& operator[](size_t i) const { return array_.packets[i]; }

 private:
  struct Array {
    std::unique_ptr<Packet[]> packets;
    size_t size = 0;
  };
  static Array& OfThread() {
    thread_local Array kept;
    return kept;
  }

  Array array_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PACKET_STORE_H_
