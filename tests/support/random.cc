// SPDX-License-Identifier: Apache-2.0
#include "tests/support/random.h"

#include <bit>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <string_view>

#include "core/base/mix_bits.h"

namespace sightline::testing_support {
namespace {

constexpr uint64_t kDefaultSeed = 1;

uint64_t ReadSeed() {
  const char* const text = std::getenv("SIGHTLINE_SEED");
  if (text == nullptr || *text == '\0') return kDefaultSeed;
  if (std::string_view(text) == "random") {
    std::random_device device;
    return (uint64_t{device()} << 32) | device();
  }
  char* end = nullptr;
  const uint64_t seed = std::strtoull(text, &end, 10);
  if (*end != '\0') {
    ADD_FAILURE() << "SIGHTLINE_SEED=" << text << " is neither a number nor \"random\"";
  }
  return seed;
}

}  // namespace

uint64_t TestSeed() {
  static const uint64_t seed = ReadSeed();
  return seed;
}

TestRng::TestRng(uint64_t stream, const char* file, int line)
    : state_(MixBits(TestSeed() + kGoldenStep) ^ MixBits(stream * kGoldenStep)),
      trace_(file, line,
             "SIGHTLINE_SEED=" + std::to_string(TestSeed()) + " stream " + std::to_string(stream)) {
}

uint64_t TestRng::operator()() { return MixBits(state_ += kGoldenStep); }

uint64_t TestRng::Below(uint64_t n) {
  // The high half of a 64 by 64 bit product: biased by less than n / 2^64.
  return static_cast<uint64_t>((static_cast<unsigned __int128>((*this)()) * n) >> 64);
}

double TestRng::Uniform(double low, double high) {
  return low + (high - low) * (static_cast<double>((*this)() >> 11) * 0x1p-53);
}

float TestRng::AnyFloat() {
  while (true) {
    const float value = std::bit_cast<float>(static_cast<uint32_t>((*this)() >> 32));
    if (std::isfinite(value)) return value;
  }
}

}  // namespace sightline::testing_support
