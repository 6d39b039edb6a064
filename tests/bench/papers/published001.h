// SPDX-License-Identifier: Apache-2.0
//
// What paper 001 prints in its Tables 2 and 3: kd-trees under PBRT on an i7 980X, twelve threads.
// Beside ours stand those of the scene that is most like it; none of them is the same scene.
//
// Thread safety: constants.
//
//   const Published001* const paper = PublishedOf("Buddha", /*path=*/false, /*leaf=*/16);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_PUBLISHED001_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_PUBLISHED001_H_

#include <string_view>

namespace sightline::bench {

// Table 2: per ray, and seconds; `boxes` is with ray-box culling.
struct Published001 {
  std::string_view scene;
  bool path;
  int leaf;
  double build, traversals, tests, tests_boxes, made, updated, trace, trace_boxes;
};
inline constexpr Published001 kPublished001[] = {
    {"Balls", false, 1, 0.031, 30.66, 6.25, 2.77, 2.21, 0.12, 1.75, 1.67},
    {"Balls", false, 4, 0.025, 26.47, 7.38, 2.33, 2.82, 0.18, 1.80, 1.63},
    {"Balls", false, 8, 0.023, 24.27, 9.89, 2.30, 2.80, 0.19, 1.81, 1.61},
    {"Balls", false, 16, 0.021, 21.39, 17.70, 2.61, 2.83, 0.22, 2.11, 1.65},
    {"Balls", false, 32, 0.019, 19.09, 30.52, 3.14, 2.69, 0.23, 2.73, 1.71},
    {"Killeroo", false, 1, 0.28, 32.39, 12.10, 2.42, 2.83, 0.46, 0.90, 0.80},
    {"Killeroo", false, 4, 0.25, 29.11, 15.18, 2.30, 4.15, 0.47, 0.96, 0.80},
    {"Killeroo", false, 8, 0.22, 25.71, 16.82, 2.26, 3.99, 0.47, 0.99, 0.78},
    {"Killeroo", false, 16, 0.20, 23.87, 19.99, 2.34, 3.90, 0.46, 0.99, 0.78},
    {"Killeroo", false, 32, 0.18, 21.51, 34.53, 2.76, 3.78, 0.46, 1.23, 0.79},
    {"Buddha", false, 1, 8.36, 36.00, 9.36, 3.85, 2.79, 0.14, 1.50, 1.41},
    {"Buddha", false, 4, 7.72, 31.27, 12.21, 3.54, 3.01, 0.14, 1.58, 1.38},
    {"Buddha", false, 8, 7.04, 26.99, 12.31, 3.26, 3.29, 0.21, 1.61, 1.35},
    {"Buddha", false, 16, 6.23, 25.31, 15.83, 3.60, 3.26, 0.21, 1.77, 1.36},
    {"Buddha", false, 32, 5.63, 23.68, 23.59, 4.14, 3.23, 0.21, 2.08, 1.43},
    {"Sponza", false, 1, 0.73, 51.99, 17.61, 3.35, 2.58, 0.53, 0.38, 0.36},
    {"Sponza", false, 4, 0.64, 48.56, 21.32, 3.37, 4.00, 0.55, 0.39, 0.37},
    {"Sponza", false, 8, 0.47, 42.62, 31.18, 3.46, 4.01, 0.58, 0.41, 0.37},
    {"Sponza", false, 16, 0.33, 37.96, 38.40, 3.95, 3.68, 0.65, 0.41, 0.37},
    {"Sponza", false, 32, 0.25, 33.43, 54.16, 4.73, 3.50, 0.69, 0.44, 0.38},
    {"Sponza", true, 1, 0.73, 49.84, 18.70, 4.20, 3.16, 0.52, 4.62, 4.21},
    {"Sponza", true, 4, 0.64, 45.88, 21.65, 4.18, 3.99, 0.55, 4.83, 4.19},
    {"Sponza", true, 8, 0.47, 41.07, 28.17, 4.27, 3.92, 0.60, 5.12, 4.25},
    {"Sponza", true, 16, 0.33, 36.17, 36.83, 4.72, 3.58, 0.64, 5.33, 4.17},
    {"Sponza", true, 32, 0.25, 31.32, 56.83, 5.62, 3.33, 0.68, 6.62, 4.32}};

// Table 3: nodes and primitive lists, in kilobytes the tree and the triangles' boxes.
struct PublishedMemory001 {
  std::string_view scene;
  int leaf;
  double nodes, references, tree_kb, boxes_kb;
};
inline constexpr PublishedMemory001 kPublishedMemory001[] = {
    {"Balls", 1, 59567, 27933, 574, 173},
    {"Balls", 4, 16497, 18498, 201, 173},
    {"Balls", 8, 7217, 12877, 106, 173},
    {"Balls", 16, 2765, 9985, 60, 173},
    {"Balls", 32, 1313, 9115, 45, 173},
    {"Killeroo", 1, 313605, 373997, 3910, 790},
    {"Killeroo", 4, 191393, 326854, 2772, 790},
    {"Killeroo", 8, 78431, 194878, 1373, 790},
    {"Killeroo", 16, 27067, 112179, 649, 790},
    {"Killeroo", 32, 9881, 75394, 371, 790},
    {"Buddha", 1, 6495245, 8809544, 85156, 25493},
    {"Buddha", 4, 4539243, 8087699, 67055, 25493},
    {"Buddha", 8, 2311833, 5791524, 40684, 25493},
    {"Buddha", 16, 835053, 3402189, 19813, 25493},
    {"Buddha", 32, 304035, 2280724, 11284, 25493},
    {"Sponza", 1, 882557, 1502004, 12762, 1560},
    {"Sponza", 4, 652499, 1406676, 10592, 1560},
    {"Sponza", 8, 323837, 1007575, 6465, 1560},
    {"Sponza", 16, 103519, 533821, 2893, 1560},
    {"Sponza", 32, 29821, 270507, 1289, 1560}};

// Null: the paper has no such row.
inline const Published001* PublishedOf(std::string_view scene, bool path, int leaf) {
  for (const Published001& row : kPublished001) {
    if (row.scene == scene && row.path == path && row.leaf == leaf) return &row;
  }
  return nullptr;
}
inline const PublishedMemory001* PublishedMemoryOf(std::string_view scene, int leaf) {
  for (const PublishedMemory001& row : kPublishedMemory001) {
    if (row.scene == scene && row.leaf == leaf) return &row;
  }
  return nullptr;
}

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_PUBLISHED001_H_
