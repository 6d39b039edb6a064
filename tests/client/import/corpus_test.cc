// SPDX-License-Identifier: Apache-2.0
//
// The fuzz target over its seed corpus: each seed as it is, cut at every length, and with bytes
// changed at random. What it requires of a scene (fuzz_mesh_readers.cc) ends the process when it is
// broken.
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace sightline {
namespace {

void FuzzOne(const std::string& input) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(input.data()), input.size());
}

std::vector<std::string> Seeds() {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry :
       std::filesystem::directory_iterator(SIGHTLINE_SOURCE_DIR "/tests/fuzz/corpus/mesh")) {
    paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> seeds;
  for (const std::filesystem::path& path : paths) {
    std::ifstream file(path, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return seeds;
}

TEST(MeshCorpusTest, HasASeedForEveryReader) {
  std::string readers;
  for (const std::string& seed : Seeds()) readers += seed.at(0);
  for (char reader = '0'; reader <= '8'; ++reader) {
    EXPECT_NE(readers.find(reader), std::string::npos) << reader;
  }
}

TEST(MeshCorpusTest, SurvivesSeedsCutAtEveryLength) {
  for (const std::string& seed : Seeds()) {
    for (size_t size = 0; size <= seed.size(); ++size) FuzzOne(seed.substr(0, size));
  }
}

TEST(MeshCorpusTest, SurvivesSeedsWithBytesChanged) {
  const std::vector<std::string> seeds = Seeds();
  testing_support::TestRng rng;
  constexpr char kTokens[] = "0123456789-+.eE#\\/\n \"{}[],:nanif";
  for (int i = 0; i < 20000; ++i) {
    std::string input = seeds[rng.Below(seeds.size())];
    for (uint64_t change = 0, changes = 1 + rng.Below(4); change < changes; ++change) {
      const size_t at = 1 + rng.Below(input.size() - 1);
      input[at] =
          rng.Chance(0.5) ? kTokens[rng.Below(sizeof(kTokens) - 1)] : static_cast<char>(rng());
    }
    FuzzOne(input);
  }
}

}  // namespace
}  // namespace sightline
