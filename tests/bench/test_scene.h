// SPDX-License-Identifier: Apache-2.0
//
// A built-in scene for tests of the benchmark: read, and indexed with a pool that it brings along.
//
// Thread safety: as its members.
//
//   TestScene hall("builtin:hall:30000");
//   MakeWorkload(spec, hall.source, hall.scene, hall.pool);
#ifndef SIGHTLINE_TESTS_BENCH_TEST_SCENE_H_
#define SIGHTLINE_TESTS_BENCH_TEST_SCENE_H_

#include <string>
#include <utility>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/base/parallel.h"
#include "tests/bench/bench_scene.h"

namespace sightline::bench {

struct TestScene {
  // REQUIRES: the name of a built-in scene (ReadScene).
  explicit TestScene(const std::string& name) : pool(2) {
    auto read = ReadScene(name, "");
    SIGHTLINE_CHECK(read.ok()) << read.status();
    source = *std::move(read);
    auto built = IndexScene(source, {}, pool);
    SIGHTLINE_CHECK(built.ok()) << built.status();
    scene = *std::move(built);
  }

  ThreadPool pool;
  SceneSource source;
  IndexedGeometry scene;
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_TEST_SCENE_H_
