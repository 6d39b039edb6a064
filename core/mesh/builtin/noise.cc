// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/noise.h"

#include <cmath>

#include "core/base/mix_bits.h"
#include "core/mesh/builtin/deterministic_math.h"

namespace sightline {
namespace {

double Fade(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

uint64_t HashLattice(int64_t x, int64_t y, int64_t z, uint64_t seed) {
  uint64_t h = seed + static_cast<uint64_t>(x) * kGoldenStep;
  h ^= static_cast<uint64_t>(y) * 0xC2B2AE3D27D4EB4Fu;
  h += static_cast<uint64_t>(z) * 0x165667B19E3779F9u;
  return MixBits(h);
}

// Dot of a hashed gradient (three signed bytes, not normalized: varied enough, and cheap) with d.
double Gradient(uint64_t h, double dx, double dy, double dz) {
  const double gx = static_cast<double>(static_cast<int>(h & 255) - 127);
  const double gy = static_cast<double>(static_cast<int>((h >> 8) & 255) - 127);
  const double gz = static_cast<double>(static_cast<int>((h >> 16) & 255) - 127);
  return ((gx * dx + gy * dy) + gz * dz) * (1.0 / 96);
}

// Where octave `i` lies: off the lattice points of the others.
Vec3d Octave(Vec3d p, double frequency, int i) {
  return {p.x * frequency + 17.31 * i, p.y * frequency + 5.77 * i, p.z * frequency + 31.13 * i};
}

// Octaves of `noise(frequency, octave)`, each half as high as the one before.
template <typename Noise>
double SumOctaves(int octaves, Noise&& noise) {
  double sum = 0, weight = 0.5, frequency = 1;
  for (int i = 0; i < octaves; ++i) {
    sum += weight * noise(frequency, i);
    weight *= 0.5;
    frequency *= 2;
  }
  return sum;
}

template <typename Noise>
double SumRidges(int octaves, Noise&& noise) {
  double sum = 0, weight = 0.5, frequency = 1, carry = 1;
  for (int i = 0; i < octaves; ++i) {
    double ridge = 1 - std::abs(noise(frequency, i));
    ridge = ridge * ridge * carry;
    carry = Clamp(ridge * 1.6, 0, 1);
    sum += weight * ridge;
    weight *= 0.5;
    frequency *= 2;
  }
  return sum;
}

}  // namespace

double GradientNoise(Vec3d p, uint64_t seed) {
  const double fx = std::floor(p.x), fy = std::floor(p.y), fz = std::floor(p.z);
  const double x = p.x - fx, y = p.y - fy, z = p.z - fz;
  const int64_t ix = static_cast<int64_t>(fx), iy = static_cast<int64_t>(fy);
  const int64_t iz = static_cast<int64_t>(fz);
  const double u = Fade(x), v = Fade(y), w = Fade(z);
  double corner[8];
  for (int c = 0; c < 8; ++c) {
    const int dx = c & 1, dy = (c >> 1) & 1, dz = c >> 2;
    corner[c] = Gradient(HashLattice(ix + dx, iy + dy, iz + dz, seed), x - dx, y - dy, z - dz);
  }
  const double low = Lerp(Lerp(corner[0], corner[1], u), Lerp(corner[2], corner[3], u), v);
  const double high = Lerp(Lerp(corner[4], corner[5], u), Lerp(corner[6], corner[7], u), v);
  return Lerp(low, high, w);
}

double GradientNoise2(double px, double py, uint64_t seed) {
  const double fx = std::floor(px), fy = std::floor(py);
  const double x = px - fx, y = py - fy;
  const int64_t ix = static_cast<int64_t>(fx), iy = static_cast<int64_t>(fy);
  const double u = Fade(x), v = Fade(y);
  double corner[4];
  for (int c = 0; c < 4; ++c) {
    const int dx = c & 1, dy = c >> 1;
    corner[c] = Gradient(HashLattice(ix + dx, iy + dy, 0, seed), x - dx, y - dy, 0);
  }
  return Lerp(Lerp(corner[0], corner[1], u), Lerp(corner[2], corner[3], u), v);
}

double Fbm(Vec3d p, int octaves, uint64_t seed) {
  return SumOctaves(octaves, [&](double frequency, int i) {
    return GradientNoise(Octave(p, frequency, i), seed);
  });
}

double Ridged(Vec3d p, int octaves, uint64_t seed) {
  return SumRidges(octaves, [&](double frequency, int i) {
    return GradientNoise(Octave(p, frequency, i), seed);
  });
}

double Fbm2(double x, double y, int octaves, uint64_t seed) {
  return SumOctaves(octaves, [&](double frequency, int i) {
    const Vec3d q = Octave({x, y, 0}, frequency, i);
    return GradientNoise2(q.x, q.y, seed);
  });
}

double Ridged2(double x, double y, int octaves, uint64_t seed) {
  return SumRidges(octaves, [&](double frequency, int i) {
    const Vec3d q = Octave({x, y, 0}, frequency, i);
    return GradientNoise2(q.x, q.y, seed);
  });
}

}  // namespace sightline
